"""One partner: their packets are decrypted, checked, counted and put on a timeline of their own."""

from collections.abc import Callable
from dataclasses import dataclass

from app.call.core.parcel import Receipt
from app.call.media.face import FaceCounts, due_by, end_of, note
from app.call.media.timeline import Timeline
from app.call.media.voice import Sound, VoiceDecoder, VoiceTrack
from app.call.wire.agreement import Hello
from app.call.wire.packet import MalformedError, Packer, Tick
from app.call.wire.seal import Keyring, SealError
from sensors.types import NS

RATE = 250.0  # packets a second that are looked at; an honest partner sends 130
HEARD_NS = NS
HEADERS = 50  # bytes of IP, UDP, SRTP around a packet


@dataclass
class PartnerCounts:
    packets: int = 0
    bytes: int = 0
    refused: int = 0  # forged, repeated, damaged
    flooded: int = 0  # more than anybody needs
    codes: int = 0  # packets of them, whose counters have no gaps ...
    first_code: int = 0  # ... from this one ...
    newest_code: int = -1  # ... to this one, but for what was lost
    first_ns: int = 0

    @property
    def loss(self) -> float:
        """Share of the code packets that were lost, 0..1."""
        sent = self.newest_code - self.first_code + 1
        return max(1 - self.codes / sent, 0.0) if self.codes else 0.0

    def kbps(self, until_ns: int) -> float:
        """Received rate in kb/s, headers included."""
        bits = 8 * (self.bytes + HEADERS * self.packets)
        return bits * 1e6 / max(until_ns - self.first_ns, 1)

    def count(self, stream: str, counter: int, size: int, now_ns: int) -> None:
        if stream == "codes":
            self.first_code = min(self.first_code, counter) if self.codes else counter
            self.newest_code = max(self.newest_code, counter)
            self.codes += 1
        self.first_ns = self.first_ns or now_ns
        self.packets += 1
        self.bytes += size


class Partner:
    """Lives as long as the call; its connection may come and go."""

    def __init__(self, identity: str, keys: Keyring, packer: Packer, decoder: VoiceDecoder) -> None:
        self.identity = identity
        self.hello: Hello | None = None  # while they are here
        self.name = ""  # that they gave last
        self.counts = PartnerCounts()
        self.timeline = Timeline()
        self.voice = VoiceTrack(self.timeline, decoder)
        self.face = FaceCounts()
        self.receipt: Receipt | None = None  # of the avatar's file that comes
        self.problem = ""  # reason of the last refusal, one line
        self.heard_ns = -HEARD_NS  # when voice last came
        self.came_ns = 0  # when anything last came
        self.hello_ns = 0
        self._keys, self._packer = keys, packer
        self._known: dict[int, None] = {}  # ticks, oldest first
        self._offset = 0  # of the newest one's end, see end_of
        self._allowance, self._counted_ns = RATE, 0

    def greet(self, hello: Hello, now_ns: int) -> Hello | None:
        """Take what they say of themselves; returns what held before."""
        before, self.hello, self.name, self.hello_ns = self.hello, hello, hello.name, now_ns
        return before

    def packet(
        self, stream: str, sealed: bytes, now_ns: int, show: Callable[[Tick, int], None]
    ) -> None:
        """Take a packet of media; new ticks go to `show` with the media at which they are due."""
        if not self._allow(now_ns):
            self.counts.flooded += 1
            return
        try:
            counter, plain = self._keys.open(self.identity, stream, sealed)
            if stream == "codes":
                self._face(plain, now_ns, show)
            else:
                self.voice.push(counter, plain, now_ns)
                self.heard_ns = now_ns
        except (SealError, MalformedError) as error:
            self.counts.refused += 1
            self.problem = str(error)
            return
        self.counts.count(stream, counter, len(sealed), now_ns)
        self.came_ns = now_ns

    def pull(self, count: int, heard_ns: int, now_ns: int) -> Sound:
        """[count] samples, the first of which is heard at `heard_ns`."""
        sound = self.voice.pull(count, heard_ns)
        if self.timeline.started:
            self.face.count(due_by(self.timeline.media_at(now_ns), self._offset), self._known)
        return sound

    def is_heard(self, now_ns: int) -> bool:
        return now_ns - self.heard_ns < HEARD_NS

    def close(self) -> None:
        self.voice.close()

    def _face(self, plain: bytes, now_ns: int, show: Callable[[Tick, int], None]) -> None:
        new, offset = self._packer.open(plain, self._known)
        self._offset = offset
        for tick in reversed(new):
            self._known[tick.index] = None
            show(tick, end_of(tick.index, offset))
        note(self.timeline, [tick.index for tick in new], offset, now_ns)
        while len(self._known) > 200:
            del self._known[next(iter(self._known))]

    def _allow(self, now_ns: int) -> bool:
        passed = (now_ns - self._counted_ns) / NS
        self._allowance = min(self._allowance + passed * RATE, RATE)
        self._counted_ns = now_ns
        if self._allowance < 1:
            return False
        self._allowance -= 1
        return True
