"""Correlation of two curves and the delay between them."""

import numpy as np

from encoder.types import Doubles


def best_shift(motion: Doubles, sound: Doubles, reach: int = 3) -> tuple[float, int]:
    """Largest Pearson r of [T] and [T] over shifts within +-reach, and it (> 0: motion is late)."""
    best = (-1.0, 0)
    for shift in range(-reach, reach + 1):
        a = motion[max(0, shift) : len(motion) + min(0, shift)]
        b = sound[max(0, -shift) : len(sound) + min(0, -shift)]
        if min(a.std(), b.std()) > 1e-6:
            best = max(best, (float(np.corrcoef(a, b)[0, 1]), shift))
    return best
