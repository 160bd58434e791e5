"""Playback: a recorded session as if it were live, in an endless loop, for a viewer.

Flow: Recording -> Playback.poll -> Assembler. Times are this clock's and samples count on, so that
pausing, jumping and beginning anew look to everything behind it like a live source that goes on.
For the same codes every time there is ReplaySource.
"""

from collections.abc import Callable
from dataclasses import replace

from sensors.session.recording import Recording
from sensors.session.timeline import AudioEntry, EmotionEntry, EyeEntry, end_ns
from sensors.types import NS, AudioPacket, Clock, EmotionPacket, EyePacket, Packet, SourceInfo

MAX_LATE_NS = NS  # after a stall of the machine it goes on from where it was


class Playback:
    """A Source without an end; `pause`, `jump` and `stop` may come from another thread."""

    def __init__(
        self,
        recording: Recording,
        clock: Clock,
        *,
        eyes: bool,  # also the eye videos
        waits: Callable[[], bool],  # asked at the start, until it is False: nobody watches yet
    ) -> None:
        entries = [e for e in recording.entries if eyes or not isinstance(e, EyeEntry)]
        self._entries = sorted(entries, key=end_ns)
        self._recording, self._clock, self._waits = recording, clock, waits
        self._start_ns = min((e.t_ns for e in entries), default=0)
        self.info = SourceInfo(
            recording.info.name,
            audio=recording.info.audio,
            eyes=tuple(recording.eyes) if eyes else (),
            head=recording.info.head,
        )
        self.dropped = 0
        self.exhausted = not any(isinstance(e, AudioEntry) for e in entries)
        self.paused = False
        self._waiting = True
        self._wanted_ns: int | None = 0  # a jump to this time from the start; None: play on
        self._position_ns = self._start_ns  # of the recording, at `_played_ns` of the clock
        self._played_ns = self._next = 0
        self._samples = self._shift = 0  # given out so far; to be added to what was recorded
        self._counters = [0, 0]
        self._emotion = self._told = ""  # where it goes on; what was given out last

    def open(self) -> None:
        self._played_ns = self._clock.now_ns()
        self._recording.pace()

    def close(self) -> None:
        self._recording.close()

    def stop(self) -> None:
        self.exhausted = True

    def pause(self) -> None:
        """Hold still, or go on."""
        self.paused = not self.paused

    def jump(self, seconds: float) -> None:
        """Go on from there; behind the end it begins anew."""
        self._wanted_ns = int(max(seconds, 0.0) * NS) % max(self._recording.duration_ns, 1)

    def poll(self) -> list[Packet]:
        now_ns = self._clock.now_ns()
        passed_ns, self._played_ns = now_ns - self._played_ns, now_ns
        if self._waiting:
            self._waiting = self._waits()
        if self._wanted_ns is not None:
            self._go(self._start_ns + self._wanted_ns)
        if self._waiting or self.paused or self.exhausted:
            return []
        self._position_ns += min(passed_ns, MAX_LATE_NS)
        packets: list[Packet] = []
        if self._emotion != self._told:
            packets.append(self._now(EmotionPacket(now_ns, self._emotion), 0))
        while end_ns(self._entries[self._next]) <= self._position_ns:
            packet = self._recording.packet(self._entries[self._next])
            if packet is None:
                self.dropped += 1
            else:
                packets.append(self._now(packet, now_ns - self._position_ns))
            self._next += 1
            if self._next == len(self._entries):
                self._go(self._start_ns)
                break
        return packets

    def _go(self, to_ns: int) -> None:
        """Play on from this time of the recording."""
        self._wanted_ns, self._position_ns, self._emotion = None, to_ns, ""
        later = (k for k, e in enumerate(self._entries) if end_ns(e) >= to_ns)
        self._next = next(later, 0)
        if end_ns(self._entries[self._next]) < to_ns:  # behind the last one that is played
            self._position_ns = self._start_ns
        for entry in self._entries[: self._next]:
            if isinstance(entry, EmotionEntry):
                self._emotion = entry.words
        sounds = (e for e in self._entries[self._next :] if isinstance(e, AudioEntry))
        first = next(sounds, None)
        self._shift = self._samples - (first.first_sample if first else 0)

    def _now(self, packet: Packet, later_ns: int) -> Packet:
        """The packet as if it had just come."""
        packet = replace(packet, t_ns=packet.t_ns + later_ns)
        if isinstance(packet, AudioPacket):
            packet = replace(packet, first_sample=packet.first_sample + self._shift)
            self._samples = packet.first_sample + len(packet.samples)
        elif isinstance(packet, EyePacket):
            packet = replace(packet, counter=self._counters[packet.eye])
            self._counters[packet.eye] += 1
        elif isinstance(packet, EmotionPacket):
            self._emotion = self._told = packet.words
        return packet
