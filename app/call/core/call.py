"""One end of a call: its sound, face and consent, and the partners it hears and sees.

microphone -> speak -> Opus -+
loop's ticks -> tick --------+-> sealed -> Room ==network==> partner's Room -> Partner
loudspeaker <- pull <- VoiceTrack of each Partner      loop <- show <- ticks of each Partner
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from app.call.core.outgoing import Outgoing
from app.call.core.parcel import Parcel, Receipt, still_here
from app.call.core.partner import Partner
from app.call.media.opus import OpusDecoder
from app.call.media.srtp import Stream
from app.call.rooms.room import AVATAR, BYE, HELLO, Events, Room
from app.call.wire import agreement
from app.call.wire.agreement import MAX_PEOPLE, Hello
from app.call.wire.packet import Basis, MalformedError, Packer, Tick
from app.call.wire.seal import Keyring, SealError
from sensors.types import NS

Sound = NDArray[np.float32]
GONE_NS = 5 * NS  # without a hello or a packet


@dataclass(frozen=True, kw_only=True)
class Sight:
    """A partner's tick on its way to the picture."""

    identity: str
    tick: Tick
    due: int  # media, see FaceTrack


class Call:
    """One end. One thread at a time; time is an argument."""

    def __init__(
        self,
        secret: bytes,
        hello: Hello,
        basis: Basis,
        tell: Callable[[str], None],
        show: Callable[[Sight, int], None],  # with our clock
        now_ns: Callable[[], int],
    ) -> None:
        self.hello = hello
        self._asks = not hello.accepted  # the person, about everybody who comes
        self.partners: dict[str, Partner] = {}
        self.left: deque[Partner] = deque(maxlen=32)  # that the report keeps
        self.room: Room | None = None
        self.parcel: Parcel | None = None  # offered
        self.files: dict[str, bytes] = {}  # avatars that have come, by digest
        self.sent_bytes = self.unsendable = 0
        self._keys = Keyring(secret, hello.identity)
        self._packer = Packer(basis)
        self._outgoing = Outgoing(self._packer, self._send)
        self._tell, self._show, self._now_ns = tell, show, now_ns
        self._told: dict[str, str] = {}

    def events(self) -> Events:
        """What a room needs of this call."""
        return Events(
            packet=self._packet,
            seal=self._seal,
            open=self._open,
            message=self._message,
            opened=self.say_hello,
            ready=self.may_send,
            tell=self._tell,
        )

    def present(self) -> list[tuple[Partner, Hello]]:
        """The partners who are here now, with what they said last."""
        return [(p, p.hello) for p in self.partners.values() if p.hello]

    def may_send(self) -> bool:
        return agreement.may_send(self.hello, self._hellos())

    def may_record(self) -> bool:
        return agreement.may_record(self.hello, self._hellos())

    def change(self, **state: object) -> None:
        """Set fields of the hello and send it: accepted, muted, records, ..."""
        self.hello = replace(self.hello, **state)
        self.say_hello()

    def say_hello(self) -> None:
        now_ns, here = self._now_ns(), self.present()
        self.hello = replace(
            self.hello,
            now_ns=now_ns,
            origin_ns=self._outgoing.origin_ns or 0,
            met=tuple(p.identity for p, _ in here),
            has=tuple(self.files),
            hears=tuple(p.identity for p, _ in here if p.is_heard(now_ns)),
            echoes=tuple((p.identity, hello.now_ns, p.hello_ns) for p, hello in here),
        )
        if self.room is not None:
            self.room.say(HELLO + self.hello.to_bytes())

    def step(self) -> None:
        """Once a second: send the hello again and drop partners that are gone."""
        now_ns = self._now_ns()
        for partner in self.partners.values():
            if now_ns - max(partner.hello_ns, partner.came_ns) > GONE_NS and partner.hello:
                self._tell(f"{partner.hello.name} has lost the connection")
                partner.hello = None
        self.say_hello()
        if self.parcel and self.room and agreement.may_send_file(self.hello, self._hellos()):
            for part in self.parcel.parts():
                self.room.say(AVATAR + part)

    def say_bye(self) -> None:
        if self.room is not None:
            self.room.say(BYE)

    def close(self) -> None:
        """Free the encoder and every partner's decoder."""
        self._outgoing.close()
        for partner in self.partners.values():
            partner.close()

    def speak(self, first_sample: int, samples: Sound, t_ns: int) -> None:
        """Send sound of the microphone; `first_sample` and `t_ns` are those of its first sample."""
        self._outgoing.speak(first_sample, samples, t_ns, self.hello.muted)

    def tick(self, tick: Tick, end_ns: int) -> None:
        """What the own face does; `end_ns`: the time at the end of the tick's sound."""
        try:
            self._outgoing.tick(tick, end_ns)
        except MalformedError as error:
            self._tell_once("own face", f"own face: {error}")

    def pull(self, count: int, heard_ns: int) -> Sound:
        """[count] samples of everybody, the first of which is heard at `heard_ns`."""
        out = np.zeros(count, np.float32)
        now_ns = min(heard_ns, self._now_ns())  # what is heard later is also seen later
        for partner in self.partners.values():
            out += partner.pull(count, heard_ns, now_ns)
        return np.minimum(np.maximum(out, -1), 1)

    def _send(self, stream: Stream, plain: bytes, media: int, counter: int | None) -> None:
        if self.room is None or not self.may_send():
            return
        sealed = self._keys.seal(stream, plain, counter)
        if self.room.send(stream, sealed, media):
            self.sent_bytes += len(sealed)
        else:
            self.unsendable += 1

    def _packet(self, identity: str, stream: Stream, sealed: bytes) -> None:
        partner, now_ns = self.partners.get(identity), self._now_ns()
        if partner is None or partner.hello is None:
            return
        if agreement.may_receive(self.hello, partner.hello):
            show = self._show
            partner.packet(
                *(stream, sealed, now_ns),
                lambda tick, due: show(Sight(identity=identity, tick=tick, due=due), now_ns),
            )
            if partner.problem:
                self._tell_once(partner.name, f"{partner.name}: {partner.problem}")

    def _seal(self, message: bytes) -> bytes:
        return bytes.fromhex(self.hello.identity) + self._keys.seal("control", message)

    def _open(self, data: bytes) -> tuple[str, bytes]:
        identity = data[:16].hex()
        return identity, self._keys.open(identity, "control", data[16:])[1]

    def _message(self, identity: str, message: bytes) -> None:
        kind, body = message[:1], message[1:]
        if kind == BYE:
            self._leave(identity)
        elif kind == AVATAR:
            self._take_part(identity, body)
        elif kind == HELLO:
            try:
                self._greet(identity, agreement.read_hello(body))
            except (MalformedError, SealError) as error:
                self._tell_once(identity, str(error))

    def _greet(self, identity: str, hello: Hello) -> None:
        if hello.identity != identity:
            raise SealError("hello: expected the sender's own identity")
        if hello.basis != self._packer.number:
            raise MalformedError(
                f"{hello.name}: expected face basis {self._packer.number:04x}, got "
                f"{hello.basis:04x}; both ends need the same version of livedrive"
            )
        partner = self.partners.get(identity)
        if partner is None:
            self._forget_consent()  # who has vanished and not come back had it
            if len(self.partners) >= MAX_PEOPLE - 1:
                if not (vanished := [p.identity for p in self.partners.values() if not p.hello]):
                    raise MalformedError(f"{hello.name}: expected {MAX_PEOPLE} people at most")
                self._leave(vanished[0])
            partner = Partner(identity, self._keys, self._packer, OpusDecoder())
            self.partners[identity] = partner
        before = partner.greet(hello, self._now_ns())
        for line in agreement.news(self.hello, before, hello):
            self._tell(line)
        known = before and identity in self.hello.met and (before.met, before.accepted)
        if known != (hello.met, hello.accepted):
            self.say_hello()

    def _take_part(self, identity: str, part: bytes) -> None:
        """Of an avatar's file that somebody here agreed to take."""
        partner = self.partners.get(identity)
        hello = partner.hello if partner else None
        if partner is None or hello is None or not (self.hello.takes_avatars and hello.parcel):
            return
        if hello.parcel in self.files:
            return
        if partner.receipt is None or partner.receipt.digest != hello.parcel:
            partner.receipt = Receipt(hello.parcel, hello.parcel_bytes)
        try:
            data = partner.receipt.add(part)
        except MalformedError as error:
            self._tell_once(hello.name, f"{hello.name}: {error}")
        else:
            if data is not None:
                self.files = still_here(self.files, self._hellos()) | {hello.parcel: data}

    def _leave(self, identity: str) -> None:
        partner = self.partners.pop(identity, None)
        if partner is not None:
            self._tell(f"{partner.name} has left")
            partner.close()
            self.left.append(partner)
            self._forget_consent()

    def _forget_consent(self) -> None:
        """Where all are gone that it was given for; given before anybody came, it stays."""
        if self._asks and (self.partners or self.left) and not self.present():
            self.hello = replace(self.hello, accepted=False)

    def _hellos(self) -> list[Hello]:
        return [hello for _, hello in self.present()]

    def _tell_once(self, about: str, line: str) -> None:
        if self._told.get(about) != line:
            self._told[about] = line
            self._tell(line)
