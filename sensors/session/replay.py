"""ReplaySource: a recorded session as a Source, as fast as it is asked or paced by a clock.

Flow: Recording -> ReplaySource.poll -> Assembler. Both paces give the same packets in the recorded
order of arrival with their recorded times; only the grouping into polls differs, and frames do not
depend on that.
"""

from sensors.session.recording import Recording
from sensors.session.timeline import AudioEntry, EyeEntry, end_ns
from sensors.types import SAMPLE_RATE, SAMPLES_PER_FRAME, Clock, Packet, SourceInfo

MAX_POLL_SAMPLES = SAMPLE_RATE  # after a stall, a real-time poll hands out 1 s at most
MAX_POLL_PACKETS = 256


class ReplaySource:
    """Plays a recording; memory use does not grow with its length."""

    def __init__(
        self, recording: Recording, clock: Clock, realtime: bool = False, eyes: bool = True
    ) -> None:
        """With `eyes` False the eye videos are left alone: decoding two costs 2-4 ms a frame."""
        self._recording = recording
        self._clock = clock
        self._realtime = realtime
        self._entries = [e for e in recording.entries if eyes or not isinstance(e, EyeEntry)]
        self._first_ns = min((e.t_ns for e in self._entries), default=0)
        self._is_open = False
        self._next = 0
        self._start_ns = 0
        self._dropped = 0

    @property
    def info(self) -> SourceInfo:
        return self._recording.info

    @property
    def exhausted(self) -> bool:
        return self._next >= len(self._entries)

    @property
    def dropped(self) -> int:
        """Pictures that the timeline names and the video no longer holds."""
        return self._dropped

    @property
    def missing(self) -> str:
        """One line for the user about them; empty where there are none."""
        if not self._dropped:
            return ""
        folder = self._recording.folder
        return f"{folder}: {self._dropped} eye pictures are missing; restore the eye videos"

    def open(self) -> None:
        """Start from the beginning; with `realtime`, now is the time of the first packet."""
        self._is_open = True
        self._next, self._dropped = 0, 0
        if self._realtime:
            self._recording.pace()
        self._start_ns = self._clock.now_ns()

    def poll(self) -> list[Packet]:
        """The packets that are due: one frame's worth of sound, or all that the clock allows."""
        if not self._is_open:
            raise RuntimeError("poll before open")
        if self._realtime:
            due_ns = self._clock.now_ns() - self._start_ns + self._first_ns
            max_samples = MAX_POLL_SAMPLES
        else:
            due_ns, max_samples = None, SAMPLES_PER_FRAME
        packets: list[Packet] = []
        samples = 0
        while not self.exhausted and samples < max_samples and len(packets) < MAX_POLL_PACKETS:
            entry = self._entries[self._next]
            if due_ns is not None and end_ns(entry) > due_ns:
                break
            self._next += 1
            packet = self._recording.packet(entry)
            if packet is None:
                self._dropped += 1
                continue
            packets.append(packet)
            if isinstance(entry, AudioEntry):
                samples += entry.num_samples
        return packets

    def close(self) -> None:
        self._is_open = False
        self._recording.close()
