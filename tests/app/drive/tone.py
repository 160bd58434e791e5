"""A source of sound on a manual clock."""

import numpy as np

from sensors.clock import ManualClock
from sensors.types import FPS, NS, SAMPLES_PER_FRAME, AudioPacket, Packet, SourceInfo


class Tone:
    """`frames` frames of sound that arrive on time, by a device clock that runs at `rate` times
    ours, with one stall; recorded if it has a duration."""

    dropped = 0

    def __init__(
        self,
        clock: ManualClock,
        frames: int,
        *,
        rate: float = 1.0,
        stall: range = range(0),
        duration_ns: int | None = None,
    ) -> None:
        self.clock, self.frames, self.stall = clock, frames, stall
        self.period_ns = NS / FPS / rate
        self.info = SourceInfo("tone", duration_ns=duration_ns)
        self.sent, self.closed = 0, False

    @property
    def exhausted(self) -> bool:
        return self.sent >= self.frames

    def open(self) -> None:
        self.start_ns = self.clock.now_ns()

    def poll(self) -> list[Packet]:
        due = int((self.clock.now_ns() - self.start_ns) / self.period_ns)
        if due in self.stall:
            return []
        first, self.sent = self.sent, max(self.sent, min(due, self.frames))
        sound = np.full(SAMPLES_PER_FRAME, 0.1, np.float32)
        return [
            AudioPacket(self.start_ns + round(k * self.period_ns), k * SAMPLES_PER_FRAME, sound)
            for k in range(first, self.sent)
        ]

    def close(self) -> None:
        self.closed = True
