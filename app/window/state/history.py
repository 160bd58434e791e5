"""What the panels show of the past: stage times, levels and counters of the last ticks."""

import numpy as np
from numpy.typing import NDArray

from app.drive.stages import STAGES
from sensors.types import EYE_SIZE, FPS

KEPT = 10 * FPS  # ticks
SILENCE_DB = -60.0


class History:
    """Fixed arrays, newest last; nothing grows."""

    def __init__(self) -> None:
        self.stage_ms = np.zeros((KEPT, len(STAGES)))
        self.frames = 0
        self.dropped = 0
        self.audio_gaps = 0
        self.level_db = SILENCE_DB  # falls slowly, as meters do
        self.peak_db = SILENCE_DB
        self.eyes = np.zeros((2, EYE_SIZE, EYE_SIZE), np.uint8)
        self.eye_frames: NDArray[np.float32] = np.zeros((2, 5), np.float32)
        self.eyes_valid: NDArray[np.bool_] = np.zeros(2, np.bool_)
        self.eyes_age_ms: NDArray[np.float32] = np.full(2, -1, np.float32)

    def add(self, tick: np.void) -> None:
        """Take one tick (app.window.state.shared.TICK)."""
        self.stage_ms[:-1] = self.stage_ms[1:]
        self.stage_ms[-1] = tick["stage_ms"]
        self.frames = int(tick["index"]) + 1
        self.dropped = int(tick["dropped"])
        self.audio_gaps += bool(tick["audio_gap"])
        rms, peak = (20 * np.log10(max(float(x), 1e-6)) for x in tick["level"])
        self.level_db = max(float(rms), self.level_db - 1.0, SILENCE_DB)
        self.peak_db = max(float(peak), self.peak_db - 0.35, SILENCE_DB)
        self.eyes, self.eye_frames = tick["eyes"], tick["eye_frames"]
        self.eyes_valid, self.eyes_age_ms = tick["eyes_valid"], tick["eyes_age_ms"]

    @property
    def has_eyes(self) -> bool:
        return bool((self.eyes_age_ms >= 0).any())

    def tick_ms(self, percent: float) -> float:
        """A percentile of the whole tick's time, over the ticks seen."""
        seen = self.stage_ms[-max(min(self.frames, KEPT), 1) :, -1]
        return float(np.percentile(seen, percent))
