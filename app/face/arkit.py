"""A driven face as ARKit's 52 named blendshapes: what protocols and tables are filled from."""

import numpy as np
from numpy.typing import NDArray

from render import arkit as shapes

_EYE = ("Blink", "LookDown", "LookIn", "LookOut", "LookUp", "Squint", "Wide")
# Apple's names in the column order of Live Link Face.
ARKIT_NAMES = (
    *(f"eye{part}Left" for part in _EYE),
    *(f"eye{part}Right" for part in _EYE),
    *("jawForward", "jawRight", "jawLeft", "jawOpen"),
    *("mouthClose", "mouthFunnel", "mouthPucker", "mouthRight", "mouthLeft"),
    *("mouthSmileLeft", "mouthSmileRight", "mouthFrownLeft", "mouthFrownRight"),
    *("mouthDimpleLeft", "mouthDimpleRight", "mouthStretchLeft", "mouthStretchRight"),
    *("mouthRollLower", "mouthRollUpper", "mouthShrugLower", "mouthShrugUpper"),
    *("mouthPressLeft", "mouthPressRight", "mouthLowerDownLeft", "mouthLowerDownRight"),
    *("mouthUpperUpLeft", "mouthUpperUpRight", "browDownLeft", "browDownRight", "browInnerUp"),
    *("browOuterUpLeft", "browOuterUpRight", "cheekPuff", "cheekSquintLeft", "cheekSquintRight"),
    *("noseSneerLeft", "noseSneerRight", "tongueOut"),
)
FULL_YAW_DEG, FULL_PITCH_DEG = 30.0, 25.0  # gaze at which an eyeLook channel reaches 1
_COLUMNS = [shapes.NAMES.index(name) for name in ARKIT_NAMES]


def gaze_angles(gaze: NDArray[np.float32]) -> NDArray[np.float32]:
    """Unit vectors [..., 3] -> yaw (towards the subject's left) and pitch (up) [..., 2], rad."""
    yaw = np.arctan2(gaze[..., 0], gaze[..., 2])
    return np.stack([yaw, np.arcsin(np.clip(gaze[..., 1], -1, 1))], -1)


def arkit(
    rig: NDArray[np.float32],  # [T, 53] activations
    gaze: NDArray[np.float32],  # [T, 2, 3] unit, left first
    rig_names: list[str],
) -> NDArray[np.float32]:  # [T, 52] 0..1, in the order of ARKIT_NAMES
    """Named blendshapes; the eyeLook channels follow the gaze, the tongue is never out."""
    out = shapes.from_rig(rig, rig_names)[:, _COLUMNS]
    angles = np.degrees(gaze_angles(gaze)) / [FULL_YAW_DEG, FULL_PITCH_DEG]
    for eye, (side, outward) in enumerate((("Left", 1), ("Right", -1))):
        yaw, up = outward * angles[:, eye, 0], angles[:, eye, 1]
        for part, value in {"In": -yaw, "Out": yaw, "Up": up, "Down": -up}.items():
            out[:, ARKIT_NAMES.index(f"eyeLook{part}{side}")] = value
    return out.clip(0, 1)
