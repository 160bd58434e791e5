"""A feminine and a masculine head: one direction in the 100 shape modes, from measures of a face.

The modes are those of the face data, unlabelled. Each moves the distances between landmarks; the
direction is the one along which these change as they differ between women and men.
"""

import numpy as np
from numpy.typing import NDArray

from render.types import Floats

# How a woman's face differs, in deviations of each measure; landmarks of iBUG 300-W.
LENGTHS = {
    (31, 35): -1.0,  # nose: width, length
    (27, 33): -0.5,
    (4, 12): -1.0,  # jaw, chin, cheeks, face: width
    (6, 10): -0.9,
    (2, 14): -0.2,
    (1, 15): -0.3,
    (33, 8): -0.8,  # nose to chin, nose to lips
    (33, 51): -0.9,
    (36, 39): 0.7,  # eyes: width, height
    (37, 41): 0.8,
    (51, 57): 0.7,  # lips: height, width
    (48, 54): -0.1,
}
# Differences of coordinates (axis: 1 up, 2 forward) of two landmarks.
OFFSETS = {
    (30, 33, 2): -0.5,  # tip of the nose
    (19, 37, 1): 0.8,  # brow above the eye
    (19, 37, 2): -1.2,  # ridge of the brow
    (27, 39, 2): -0.8,  # root of the nose
    (48, 62, 1): 0.5,  # corner of the mouth
}
NECK, NECK_MM = -0.9, (-110.0, 20.0)  # width: how it differs; height and depth it is measured at


def axis(
    neutral: Floats,  # [V, 3] mm
    moves: Floats,  # [K, V, 3] mm a deviation of each mode
    landmarks: NDArray[np.int32],  # [68]
) -> Floats:  # [K] unit, towards women
    """The direction in the modes."""
    near = np.flatnonzero(np.abs(neutral[:, 1:] - NECK_MM).max(1) < 8)
    sides = near[[neutral[near, 0].argmin(), neutral[near, 0].argmax()]]
    points = np.concatenate([landmarks, sides])
    rest, moved = neutral[points], neutral[points] + moves[:, points]
    change = _measures(moved) - _measures(rest)
    change /= np.sqrt((change**2).sum(0))
    out = change @ np.array([*LENGTHS.values(), *OFFSETS.values(), NECK])
    return (out / np.linalg.norm(out)).astype(np.float32)


def _measures(points: Floats) -> Floats:  # [..., 70, 3] -> [..., M]
    pairs = [*LENGTHS, (68, 69)]
    lengths = [np.linalg.norm(points[..., a, :] - points[..., b, :], axis=-1) for a, b in pairs]
    offsets = [points[..., a, k] - points[..., b, k] for a, b, k in OFFSETS]
    return np.stack([*lengths[:-1], *offsets, lengths[-1]], -1)
