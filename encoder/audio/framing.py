"""How raw sound becomes 30 FPS frames, in numbers: the resampling filter, places of features.

Shared by the torch modules (resample.py, alignment.py) and the live path (live.py).
"""

from __future__ import annotations

import numpy as np

from encoder.types import Floats

TAPS_PER_PHASE = 19


def resample_kernel(factor: int) -> Floats:
    """[19 * factor] windowed sinc that keeps every `factor`-th sample of 48 kHz.

    38 taps at factor 2, 57 at factor 3. The ringing is symmetric: sound is half the taps late.
    """
    taps = factor * TAPS_PER_PHASE
    time = np.arange(taps) - (taps - 1) / 2
    cutoff = 0.9 / factor  # of the input's Nyquist frequency; the window's skirt takes the rest
    kernel = np.sinc(cutoff * time) * np.kaiser(taps, 8.0)
    return (kernel / kernel.sum()).astype(np.float32)


def lerp_ready(num_features: int) -> int:
    """How many 30 FPS frames 100 Hz features allow: 3, 6, 10 features -> 1, 2, 3 frames."""
    return (3 * num_features + 2) // 10


def lerp_place(frame: int) -> tuple[int, float]:
    """Frame t reads at feature position (10 t + 5) / 3 -> the left feature, the right one's weight.

    Tick t ends at feature position 10 (t + 1) / 3 - 1, so the age is always 2/3 feature = 6.7 ms,
    the least that needs no feature from after the tick in any of the three phases.
    """
    return (10 * frame + 5) // 3, ((10 * frame + 5) % 3) / 3
