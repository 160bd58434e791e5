"""What goes into the eye encoder's network and what comes out of it; needs no torch.

Where: SensorFrame.eyes -> `pictures.pixels` -> `pictures.normalised` -> network -> x and y of the
gaze -> `unit`.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sensors.types import EYE_SIZE

SIDE = EYE_SIZE // 4  # 100: the network sees means of 4 x 4 pixels
FEATURES = 80  # an eye; e is 160
# What the upper face does, besides gaze, as far as an eye camera can see it.
RIG = ("eyeBlink", "eyeSquint", "eyeWide", "browDown", "browInnerUp", "browOuterUp", "cheekSquint")
MAX_SINE = 0.85  # of the angle off straight ahead
GAZE_UNIT = 0.2  # the network's 1.0 is 11.5 degrees
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


def doubt_of(raw: NDArray[np.floating]) -> NDArray[np.floating]:
    """What the network says of its gaze -> scale of the error, in GAZE_UNIT."""
    return 0.03 + 0.5 * np.logaddexp(0, raw + 0.5)


def unit(gaze: NDArray[np.floating]) -> NDArray[np.float32]:
    """x and y [..., 2] -> forward unit vectors [..., 3]."""
    xy = np.asarray(gaze, np.float64)
    length = np.linalg.norm(xy, axis=-1, keepdims=True)
    xy = xy * (MAX_SINE / np.maximum(length, MAX_SINE))
    z = np.sqrt(1 - (xy * xy).sum(-1, keepdims=True))
    return np.concatenate([xy, z], -1).astype(np.float32)
