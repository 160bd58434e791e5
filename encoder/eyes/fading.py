"""How shown eyes get from one value to the next without a jump: fades, limits, smoothing."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from encoder.eyes.format import length, within

Array = NDArray[np.float32]
FADE_FRAMES = 6  # from one source to the next; back within 300 ms
FASTEST = 0.313  # chord of 18 degrees, more than eyes turn in a frame: a misreading after a blink
CALMEST = 0.3  # share of a small move that is shown at once


class ShownEyes(NamedTuple):
    """Both eyes as the head shall show them, left first."""

    features: Array  # [2, 80]
    gaze: Array  # [2, 3] unit
    lids: Array  # [2]


def bounded(features: Array) -> Array:
    return within(features, -1, 1)


def turned(start: Array, end: Array, share: Array | np.float32) -> Array:
    """Unit vectors [..., 3], `share` of the way from one to the other."""
    gaze = start + share * (end - start)
    return (gaze / length(gaze)).astype(np.float32)


def limited(before: Array, after: Array) -> Array:
    """[2, 3] at most FASTEST away from the frame before."""
    chord = length(after - before)
    near = turned(before, after, FASTEST / np.maximum(chord, FASTEST))
    return np.where(chord > FASTEST, near, after).astype(np.float32)


def calmed(before: Array, after: Array, doubt_deg: float) -> Array:
    """[3]: moves larger than the doubt are shown at once, smaller ones bit by bit."""
    move = float(np.degrees(np.linalg.norm(after - before)))
    if move >= doubt_deg:
        return after
    return turned(before, after, np.float32(max(move / doubt_deg, CALMEST)))


def put(faded: ShownEyes | None, shown: ShownEyes | None, eye: int) -> ShownEyes | None:
    """`faded` with one eye as it is shown now."""
    if faded is None or shown is None:
        return shown
    mixed = [old.copy() for old in faded]
    for new, now in zip(mixed, shown, strict=True):
        new[eye] = now[eye]
    return ShownEyes(*mixed)


def mixed(start: ShownEyes, end: ShownEyes, frames: list[int]) -> ShownEyes:
    """Between two, as far as each eye's fade has come; at the end exactly `end`."""
    done = (np.array(frames, np.float32) + 1) / (FADE_FRAMES + 1)
    weight = (done * done * (3 - 2 * done)).astype(np.float32)
    fading = np.array(frames) < FADE_FRAMES
    parts = [
        a + weight.reshape(-1, *[1] * (a.ndim - 1)) * (b - a)
        for a, b in zip(start, end, strict=True)
    ]
    parts[1] = parts[1] / length(parts[1])
    kept = [
        np.where(fading.reshape(-1, *[1] * (b.ndim - 1)), m, b).astype(np.float32)
        for m, b in zip(parts, end, strict=True)
    ]
    return ShownEyes(*kept)
