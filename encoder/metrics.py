"""Numbers about motion, from vertices in millimetres; judged by `livedrive eval`.

Pure functions of arrays: nothing here knows networks, files or pictures.
"""

import numpy as np
from numpy.typing import NDArray

from sensors.types import FPS, SAMPLE_RATE, SAMPLES_PER_FRAME

Floats = NDArray[np.float32]
MIDDLE_MM = 8.0  # half width of the part of the lips whose opening is measured
NUM_PAIRS = 8
ENVELOPE_BAND_HZ = (2.0, 15.0)


def inner_lip_pairs(
    upper: Floats,  # [n, 3] mm, the upper lip at rest
    lower: Floats,  # [m, 3] mm, the lower lip at rest
) -> NDArray[np.int64]:  # [NUM_PAIRS, 2] rows of upper and of lower
    """Vertices that touch, or nearly, when the mouth is at rest: the inner lips at mid-mouth."""
    middle = np.flatnonzero(np.abs(upper[:, 0] - upper[:, 0].mean()) < MIDDLE_MM)
    distance = np.linalg.norm(upper[middle, None] - lower[None], axis=-1)
    nearest = np.argsort(distance.min(1), kind="stable")[:NUM_PAIRS]
    return np.stack([middle[nearest], distance[nearest].argmin(1)], 1)


def lip_opening_mm(
    upper: Floats,  # [T, n, 3]
    lower: Floats,  # [T, m, 3]
    pairs: NDArray[np.int64],  # [p, 2]
) -> NDArray[np.float64]:  # [T]
    """Vertical gap of the inner lips; below zero where they press into each other."""
    gap = upper[:, pairs[:, 0], 1].astype(np.float64) - lower[:, pairs[:, 1], 1]
    return gap.mean(1)


def envelope(audio: Floats) -> NDArray[np.float64]:  # [T * 1600] 48 kHz -> [T]
    """The sound's 2-15 Hz amplitude envelope at the end of each frame (zero phase, for judging)."""
    from scipy.signal import butter, hilbert, sosfiltfilt

    low, high = ENVELOPE_BAND_HZ
    loud = np.abs(np.asarray(hilbert(audio)))
    loud = sosfiltfilt(butter(4, high, fs=SAMPLE_RATE, output="sos"), loud)
    eight = SAMPLES_PER_FRAME // 8  # 240 Hz: the high-pass is exact there
    slow = sosfiltfilt(butter(2, low, "highpass", fs=8 * FPS, output="sos"), loud[::eight])
    return slow[7::8][: len(audio) // SAMPLES_PER_FRAME]


def best_shift(
    motion: NDArray[np.float64],  # [T]
    sound: NDArray[np.float64],  # [T]
    reach: int = 3,
) -> tuple[float, int]:
    """Largest Pearson r over shifts within +-reach frames, and the shift (> 0: motion is late)."""
    best = (-1.0, 0)
    for shift in range(-reach, reach + 1):
        a = motion[max(0, shift) : len(motion) + min(0, shift)]
        b = sound[max(0, -shift) : len(sound) + min(0, -shift)]
        best = max(best, (float(np.corrcoef(a, b)[0, 1]), shift))
    return best


def movement_mm(opening: NDArray[np.float64], settle: int = FPS // 2) -> float:
    """Peak-to-peak movement of the lips after the first half second."""
    return float(np.ptp(opening[settle:]))
