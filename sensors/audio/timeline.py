"""AudioTimeline: unbroken sound at 48 kHz, whether or not there is a microphone.

Flow: Microphone.poll -> AudioTimeline -> AudioPackets -> Assembler. The sample count is the master
clock; where the microphone is silent for too long, the monotonic clock takes over and feeds silence
marked as a gap, so the head never stops. Sound that comes back late is cut off, never played twice.
"""

import numpy as np

from sensors.types import NS, SAMPLE_RATE, AudioPacket

PATIENCE_NS = 100_000_000  # a microphone may be this late before silence takes over
LAG_NS = 50_000_000  # silence stays so far behind the clock that a returning microphone finds room
MAX_SILENCE = SAMPLE_RATE  # samples in one packet; longer gaps are a jump of the counter
# The sample count follows the device, and the device follows the clock: a packet that is further
# off than this was lost or was never missing, and is placed by its time.
MAX_ERROR_NS = 12_000_000
MAX_DRIFT = 1e-3  # how fast the time of the count may follow packet times


class AudioTimeline:
    """Renumbers microphone packets and fills what is missing."""

    def __init__(self, start_ns: int, lag_ns: int = LAG_NS) -> None:
        """`lag_ns` 0 is for runs without a microphone, where nothing can come back."""
        self.position = 0  # next sample
        self.silence = 0  # samples fed in place of sound
        self._end_ns = start_ns  # time of the next sample
        self._lag_ns = lag_ns
        self._offset: int | None = None  # from the microphone's counter; None: place by time
        self._last_t_ns = start_ns - 1

    def push(self, packet: AudioPacket) -> list[AudioPacket]:
        """Take a microphone packet; return what goes on to the assembler."""
        samples, first, t_ns, gap = packet.samples, packet.first_sample, packet.t_ns, packet.gap
        if self._offset is not None:
            jump = first + self._offset - self.position
            expected_ns = self._end_ns + jump * NS // SAMPLE_RATE
            error_ns = t_ns - expected_ns
            if jump >= 0 and abs(error_ns) <= MAX_ERROR_NS:
                most_ns = int(MAX_DRIFT * len(samples) * NS / SAMPLE_RATE)
                t_ns = expected_ns + min(max(error_ns, -most_ns), most_ns)
            else:
                self._offset = None
        if self._offset is None:
            early = max((self._end_ns - t_ns) * SAMPLE_RATE // NS, 0)
            if early >= len(samples):
                return []
            samples, first, t_ns = samples[early:], first + early, t_ns + early * NS // SAMPLE_RATE
            late = max((t_ns - self._end_ns) * SAMPLE_RATE // NS, 0)
            self._offset = self.position + late - first
            gap = gap or early > 0 or late > 0
        t_ns = max(t_ns, self._last_t_ns + 1)
        sent = AudioPacket(t_ns, first + self._offset, samples, gap)
        self._advance(sent)
        return [sent]

    def fill(self, now_ns: int) -> list[AudioPacket]:
        """Silence up to `now_ns`, less the lag, if the microphone has been silent for too long."""
        missing_ns = now_ns - self._end_ns
        if self._offset is not None and missing_ns <= PATIENCE_NS:
            return []
        self._offset = None
        missing = (missing_ns - self._lag_ns) * SAMPLE_RATE // NS
        if missing <= 0:
            return []
        num = min(missing, MAX_SILENCE)
        skipped = missing - num
        t_ns = max(self._end_ns + skipped * NS // SAMPLE_RATE, self._last_t_ns + 1)
        silence = np.zeros(num, np.float32)
        sent = AudioPacket(t_ns, self.position + skipped, silence, gap=True)
        self.silence += missing
        end_ns = self._end_ns + missing * NS // SAMPLE_RATE
        self._advance(sent)
        self._end_ns = end_ns
        return [sent]

    def _advance(self, sent: AudioPacket) -> None:
        self.position = sent.first_sample + len(sent.samples)
        self._end_ns = sent.t_ns + len(sent.samples) * NS // SAMPLE_RATE
        self._last_t_ns = sent.t_ns
