"""What goes into the eye encoder's network and what comes out of it; needs no torch.

Where: SensorFrame.eyes -> `pixels` -> `normalised` -> network -> x and y of the gaze -> `unit`.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sensors.types import EYE_SIZE

SIDE = EYE_SIZE // 4  # 100: the network sees means of 4 x 4 pixels
FEATURES = 80  # an eye; e is 160
# What the upper face does, besides gaze, as far as an eye camera can see it.
RIG = ("eyeBlink", "eyeSquint", "eyeWide", "browDown", "browInnerUp", "browOuterUp", "cheekSquint")
MIN_SPREAD = 4.0  # grey levels; a flatter picture is not stretched any further
MAX_SINE = 0.85  # of the angle off straight ahead
GAZE_UNIT = 0.2  # the network's 1.0 is 11.5 degrees
MOST = 3.0  # spreads from the mean
BRIGHT, ABOVE = 0.97, 0.5  # of the pixels; brighter ones are glints, and cut a little above
# What the tracker follows: chance (logit), opening, gaze, and the pupil's place in half widths of
# the picture (+x right, +y down); `doubt_of` reads the doubts.
MEASURES = ("present", "lid", "gaze_x", "gaze_y", "doubt", "pupil_x", "pupil_y", "pupil_doubt")
FOUND = ("present", "x", "y", "log_size", "cos_turn", "sin_turn")  # what the finder says


@dataclass(frozen=True, kw_only=True)
class EyeNetConfig:
    """Layers are (channels, kernel, stride); a stride of 1 adds its input (residual)."""

    layers: tuple[tuple[int, int, int], ...] = (
        *((8, 5, 2), (16, 3, 2), (16, 3, 1), (40, 3, 2), (40, 3, 1), (64, 3, 2), (64, 3, 1)),
    )
    features: int = FEATURES
    synthesis: int = 64  # width of the map from gaze and rig back to features
    pair: int = 64  # width of what both eyes together tell
    measure: int = 64  # width of what the measures are read from
    finder: tuple[int, int, int] = (12, 24, 48)  # channels of the network that finds the eye


PRESETS = {
    "debug": EyeNetConfig(layers=((4, 5, 4), (8, 3, 2), (8, 3, 1), (8, 3, 2)), synthesis=16),
    "default": EyeNetConfig(),
}


def pixels(
    eyes: NDArray[np.uint8],  # [2, 400, 400] left, right; or smaller, by whole steps of 100
) -> NDArray[np.uint8]:  # [2, 100, 100]
    """Small left-like pictures: means of 4 x 4 pixels, the right eye mirrored."""
    shrink = eyes.shape[1] // SIDE
    if shrink == 4:
        small = np.empty((2, SIDE, SIDE), np.uint8)
        _quarters(np.ascontiguousarray(eyes), small)
    else:
        small = _shrunk(eyes, shrink)
    small[1] = small[1, :, ::-1].copy()
    return small


def _shrunk(eyes: NDArray[np.uint8], shrink: int) -> NDArray[np.uint8]:
    rows = eyes.reshape(2, SIDE, shrink, eyes.shape[2])
    tall = rows[:, :, 0].astype(np.uint16)
    for k in range(1, shrink):
        tall += rows[:, :, k]
    small = tall[:, :, ::shrink].copy()
    for k in range(1, shrink):
        small += tall[:, :, k::shrink]
    return ((small + shrink**2 // 2) // shrink**2).astype(np.uint8)


@njit("void(u1[:, :, ::1], u1[:, :, ::1])", cache=True, nogil=True)
def _quarters(eyes: NDArray[np.uint8], small: NDArray[np.uint8]) -> None:
    """The same of 4 x 4 pixels in a twentieth of the time; compiled with the module: the first
    picture must not wait for it."""
    tall = np.empty(4 * SIDE, np.uint16)
    for eye in range(2):
        for y in range(SIDE):
            a, b, c, d = eyes[eye, 4 * y : 4 * y + 4]
            for x in range(len(tall)):
                tall[x] = np.uint16(a[x]) + np.uint16(b[x]) + np.uint16(c[x]) + np.uint16(d[x])
            for x in range(SIDE):
                four = tall[4 * x] + tall[4 * x + 1] + tall[4 * x + 2] + tall[4 * x + 3]
                small[eye, y, x] = (four + np.uint16(8)) >> np.uint16(4)


def normalised(
    small: NDArray[np.uint8],  # [B, n, n]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:  # [B, 1, n, n], [B]
    """Pictures of mean 0 and spread 1, in -3..3: exposure cancels, and glints hardly count. And the
    spreads they had.
    """
    step = small.shape[1] // 25
    some = small[:, ::step, ::step].reshape(len(small), -1)
    half, high = some.shape[1] // 2, int(BRIGHT * (some.shape[1] - 1))
    some = np.partition(some, (half, high), axis=1).astype(np.float32)
    usual, bright = some[:, half, None], some[:, high, None]
    x = small.reshape(len(small), -1).astype(np.float32)
    np.minimum(x, bright + ABOVE * (bright - usual), out=x)
    x -= np.add.reduce(x, 1, keepdims=True) / np.float32(x.shape[1])
    spread = np.sqrt(np.einsum("bi,bi->b", x, x) / x.shape[1])
    x /= np.maximum(spread, MIN_SPREAD)[:, None]
    np.minimum(np.maximum(x, -MOST, out=x), MOST, out=x)
    return x.reshape(len(small), 1, *small.shape[1:]), spread


def doubt_of(raw: NDArray[np.floating]) -> NDArray[np.floating]:
    """What the network says of its gaze -> scale of the error, in GAZE_UNIT."""
    return 0.03 + 0.5 * np.logaddexp(0, raw + 0.5)


def within(values: Any, least: float, most: float) -> Any:
    """np.clip, which takes four times as long for a few numbers."""
    return np.minimum(np.maximum(values, least), most)


def length(vectors: NDArray[Any]) -> Any:  # [..., n] -> [..., 1]
    """np.linalg.norm along the last axis, in half its time for a few numbers."""
    return np.sqrt(np.add.reduce(vectors * vectors, -1, keepdims=True))


def unit(gaze: NDArray[np.floating]) -> NDArray[np.float32]:
    """x and y [..., 2] -> forward unit vectors [..., 3]."""
    xy = np.asarray(gaze, np.float64)
    xy = xy * (MAX_SINE / np.maximum(length(xy), MAX_SINE))
    out = np.empty((*xy.shape[:-1], 3), np.float32)
    out[..., :2] = xy
    out[..., 2:] = np.sqrt(1 - np.add.reduce(xy * xy, -1, keepdims=True))
    return out
