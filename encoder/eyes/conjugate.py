"""Conjugate gaze: one direction from the estimates of two pictures.

Where: EyeReading -> `joined` -> EyeTracker.
"""

import numpy as np
from numpy.typing import NDArray

from encoder.eyes.format import unit, within

Array = NDArray[np.float32]
OPEN = 0.35  # lid opening above which gaze is reliable
USUAL_VERGENCE, MAX_VERGENCE = 0.064, 0.16  # of x, right minus left: at 1 m, at 40 cm
VERGENCE_TRUST = 0.25  # the error of each eye is larger than the variation of vergence
# Difference of the eyes' sines: below the first they share one target, above the second each
# keeps its own direction, e.g. where both cameras show the same eye.
NEAR, FAR = 0.2, 0.4


def conjugate(
    xy: Array,  # [2, 2] of both eyes, head frame
    weight: Array,  # [2] 0..1 confidence of each eye
) -> Array:  # [2, 2]
    """One direction from both eyes: equal height, slight convergence."""
    share = (weight + 1e-3) / (weight + 1e-3).sum()
    vergence = within(xy[1, 0] - xy[0, 0], 0, MAX_VERGENCE) - USUAL_VERGENCE
    vergence = USUAL_VERGENCE + VERGENCE_TRUST * weight.min() * vergence
    half = np.array([[-0.5 * vergence, 0], [0.5 * vergence, 0]], np.float32)
    middle = (share[:, None] * (xy - half)).sum(0)
    return (middle + half).astype(np.float32)


def trust(lids: Array, score: Array) -> Array:  # [2] each -> [2]
    """Confidence of each eye, 0..1: low for a shut or uncertain eye."""
    return (score * within(lids / OPEN, 0, 1)).astype(np.float32)


def joined(
    gaze: Array,  # [2, 3] unit vectors
    lids: Array,  # [2] opening
    score: Array,  # [2]
) -> Array:  # [2, 3]
    """Where both eyes look. After calibration: what is personal differs from eye to eye, and a mean
    of both with changing weights would mix it.
    """
    own, weight = gaze[:, :2], trust(lids, score)
    apart = own[1] - own[0] - np.array([USUAL_VERGENCE, 0], np.float32)
    agree = within((FAR - np.linalg.norm(apart)) / (FAR - NEAR), 0, 1)
    share = np.float32(1 - weight.min() * (1 - agree))
    return unit(own + share * (conjugate(own, weight) - own))
