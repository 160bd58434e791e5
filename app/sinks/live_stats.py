"""LiveStats: how old everything was when its code existed. A sink, for --report and the dashboard.

All times are on the run's clock: a frame's time is the end of its sound, so the latency here is
from the last sample at the microphone to the finished code.
"""

from typing import Any

import numpy as np

from app.drive.sink import FrameResult, RunInfo
from sensors.types import EYE_NAMES, FPS, NS

CAPACITY = 30 * 60 * 10  # frames: the last ten minutes


class LiveStats:
    """Keeps the last ten minutes in arrays that are filled from the start, so memory stays flat."""

    def __init__(self) -> None:
        self.frames = 0
        self.gaps = 0  # frames with sound missing
        self.dropped = 0
        self.level_db = -120.0  # of the newest frame
        self.eyes_valid = np.zeros(2, np.bool_)
        self.latency_ms = np.full(CAPACITY, np.nan)
        self.eye_age_ms = np.full((2, CAPACITY), np.nan)
        self._first_ns = self._last_ns = 0

    def on_start(self, info: RunInfo) -> None:
        pass

    def on_frame(self, result: FrameResult) -> None:
        frame, slot = result.sensors, self.frames % CAPACITY
        self.latency_ms[slot] = (result.code_ns - frame.t_ns) / 1e6
        self.eye_age_ms[:, slot] = np.where(
            frame.eyes_valid, (frame.eyes_age_ns + result.code_ns - frame.t_ns) / 1e6, np.nan
        )
        self._first_ns = self._first_ns or frame.t_ns
        self._last_ns = frame.t_ns
        self.frames += 1
        self.gaps += frame.audio_gap
        self.dropped = result.dropped
        self.eyes_valid = frame.eyes_valid
        rms = float(np.sqrt(np.mean(np.square(np.nan_to_num(frame.audio)))))
        self.level_db = 20 * float(np.log10(max(rms, 1e-6)))

    def close(self) -> None:
        pass

    @property
    def audio_drift_ms(self) -> float:
        """Sample count against the clock: how far the two have come apart since the start."""
        counted_ns = max(self.frames - 1, 0) * NS // FPS
        return (self._last_ns - self._first_ns - counted_ns) / 1e6

    def report(self) -> dict[str, Any]:
        kept = min(self.frames, CAPACITY)
        out = {
            "frames_with_gap": self.gaps,
            "audio_drift_ms": round(self.audio_drift_ms, 3),
            "sound_to_code": _percentiles(self.latency_ms[:kept]),
        }
        for eye, name in enumerate(EYE_NAMES):
            ages = self.eye_age_ms[eye, :kept]
            out[f"eye_{name}_to_code"] = _percentiles(ages)
            out[f"eye_{name}_valid"] = round(float(np.isfinite(ages).mean()), 4) if kept else 0.0
        return out


def _percentiles(values_ms: np.ndarray) -> dict[str, float]:
    finite = values_ms[np.isfinite(values_ms)]
    if not len(finite):
        return {}
    p50, p95, p99 = (round(float(v), 2) for v in np.percentile(finite, (50, 95, 99)))
    return {"p50_ms": p50, "p95_ms": p95, "p99_ms": p99}
