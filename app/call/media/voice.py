"""A partner's voice, from packets to the samples that the loudspeaker asks for.

What is missing when it is due is recovered from the next packet, or concealed, and counted. The
drift of both sound cards and every change of the delay are resampled away.
"""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from app.call.media import speed
from app.call.media.opus import MAX_PAYLOAD, PACKET
from app.call.media.timeline import Timeline
from sensors.types import SAMPLE_RATE

Sound = NDArray[np.float32]
PULL = 480  # samples that a loudspeaker asks for at a time, at most, for the delay to be right
READ_AHEAD = PULL + PULL // 50 + speed.AFTER + 2  # samples decoded before the first is heard
FAR = 10 * SAMPLE_RATE // PACKET  # packets this far from the playing position are invalid
GONE = 50  # packets missing in a row: the partner is not late but away


class VoiceDecoder(Protocol):
    def decode(self, payload: bytes) -> Sound: ...
    def recover(self, following: bytes) -> Sound: ...
    def conceal(self) -> Sound: ...
    def close(self) -> None: ...


@dataclass
class VoiceCounts:
    """Packets of 10 ms, each counted when it was due."""

    played: int = 0
    recovered: int = 0  # of those: from the copy in the next packet
    concealed: int = 0  # missing
    jumps: int = 0


class VoiceTrack:
    """Push packets as they come, pull samples as they are due."""

    def __init__(self, timeline: Timeline, decoder: VoiceDecoder) -> None:
        self.counts = VoiceCounts()
        self.level = 0.0  # root mean square of the newest packet
        self._timeline, self._decoder = timeline, decoder
        self._packets: dict[int, bytes] = {}
        self._known: set[int] = set()  # packets that can be played: arrived, or copied in the next
        self._silent = False  # the partner said that nothing follows
        self._next = 0  # packet to decode
        self._missing = GONE  # in a row
        self._decoded = np.zeros(0, np.float32)
        self._start = 0  # media of the first of them
        self._at = 0.0  # which of them is heard next, and how far towards the one after it
        self._ahead = 0.0  # samples that we play too early, by the timeline
        self._playing = False

    def push(self, number: int, payload: bytes, now_ns: int) -> None:
        """Packet `number` holds samples 480 * number and on; an empty one says that the partner
        is muted from there."""
        late = self._playing and number < self._next
        if len(payload) > MAX_PAYLOAD or abs(number - self._next) > FAR and self._playing:
            return
        for playable in (number, number - 1):
            if playable not in self._known:
                self._known.add(playable)
                self._timeline.arrived("voice", playable * PACKET - READ_AHEAD, now_ns)
        if not late:
            self._packets.setdefault(number, payload)
        if len(self._known) > 2 * FAR:
            self._forget(number)

    def pull(self, count: int, heard_ns: int) -> Sound:
        """[count] samples, the first of which is heard at `heard_ns`."""
        target = self._timeline.target(heard_ns)
        if target is None:
            return np.zeros(count, np.float32)
        media = self._start + self._at
        rate = self._timeline.rate(media, target) if self._playing else None
        if rate is None:
            media, rate = max(float(int(target)), 0.0), 1.0
            self._jump(int(media))
        self._ahead = media - target
        self._timeline.played(media, heard_ns, rate)
        end = self._at + rate * count
        while len(self._decoded) < end + speed.AFTER:
            self._decoded = np.concatenate([self._decoded, self._decode()])
        out = speed.between(self._decoded, self._at, rate, count)
        used = int(end) - speed.BEFORE
        self._decoded = self._decoded[used:]
        self._start, self._at = self._start + used, end - used
        return out

    def close(self) -> None:
        self._decoder.close()
        self._playing = False

    def _jump(self, media: int) -> None:
        self.counts.jumps += self._playing
        self._playing = True
        self._next = media // PACKET
        self._start, self._at = media - speed.BEFORE, float(speed.BEFORE)
        lead = np.zeros(speed.BEFORE, np.float32)
        self._decoded = np.concatenate([lead, self._decode()[media % PACKET :]])

    def _decode(self) -> Sound:
        """The next 480 samples."""
        number = self._next
        if self._is_early(number):  # the line became slower: the sound waits for it
            self._start -= PACKET
            self._ahead -= PACKET
            self.counts.concealed += 1
            return self._decoder.conceal()
        self._next += 1
        own = self._packets.pop(number, None)
        following = self._packets.get(number + 1)
        if own == b"" or self._silent and not own:
            self._silent = True
            sound = np.zeros(PACKET, np.float32)
        elif own or following:
            self._missing, self._silent = 0, False
            self.counts.played += 1
            self.counts.recovered += own is None
            sound = self._decoder.decode(own) if own else self._decoder.recover(following or b"")
        elif self._missing >= GONE:
            sound = np.zeros(PACKET, np.float32)
        else:
            self._missing += 1
            self.counts.concealed += 1
            sound = self._decoder.conceal()
        self.level = math.sqrt(sound @ sound / PACKET)
        return sound

    def _is_early(self, number: int) -> bool:
        """Nothing is there to be played, and by the timeline it is not yet time for it."""
        there = number in self._packets or number + 1 in self._packets
        return not there and self._ahead > PACKET and self._missing < GONE and not self._silent

    def _forget(self, number: int) -> None:
        self._known = {k for k in self._known if abs(k - number) < FAR}
        self._packets = {k: p for k, p in self._packets.items() if abs(k - number) < FAR}
