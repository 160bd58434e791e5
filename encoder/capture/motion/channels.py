"""The 53 named face channels of the capture stage, and the map from ARKit's 52 names.

First thing in the flow of training data: every motion curve is a [T, 53] array in this order.
"""

import numpy as np

_SIDED_FRONT = ["browDown", "browInnerUp", "browOuterUp", "cheekPuff", "cheekSquint", "eyeBlink"]
_SIDED_EYES = ["eyeLookDown", "eyeLookIn", "eyeLookOut", "eyeLookUp", "eyeSquint", "eyeWide"]


def _both(names: list[str]) -> list[str]:
    return [f"{name}_{side}" for name in names for side in "LR"]


RIG_NAMES: tuple[str, ...] = (
    *_both(_SIDED_FRONT + _SIDED_EYES),
    "jawForward",
    "jawLeft",
    "jawOpen",
    "jawRight",
    "mouthClose",
    *_both(["mouthDimple", "mouthFrown"]),
    "mouthFunnel",
    "mouthLeft",
    *_both(["mouthLowerDown", "mouthPress"]),
    "mouthPucker",
    "mouthRight",
    "mouthRollLower",
    "mouthRollUpper",
    "mouthShrugLower",
    "mouthShrugUpper",
    *_both(["mouthSmile", "mouthStretch", "mouthUpperUp", "noseSneer"]),
)
RIG_INDEX: dict[str, int] = {name: index for index, name in enumerate(RIG_NAMES)}

# The channels that speech moves: everything from the jaw down. The others follow mood and gaze.
SPEECH_NAMES: tuple[str, ...] = tuple(
    name for name in RIG_NAMES if name.startswith(("jaw", "mouth"))
)
SPEECH_COLUMNS: tuple[int, ...] = tuple(RIG_INDEX[name] for name in SPEECH_NAMES)
# ARKit has tongueOut only; the two others are the inner tongue of t d n l and of k g.
TONGUE_NAMES: tuple[str, ...] = ("tongueOut", "tongueTipUp", "tongueBackUp")
JAW_OPEN = RIG_INDEX["jawOpen"]
MOUTH_CLOSE = RIG_INDEX["mouthClose"]
# Two names of ARKit that this rig splits in a left and a right half.
_SPLIT = ("browInnerUp", "cheekPuff")


def arkit_columns(names: list[str]) -> list[int]:
    """For each rig channel its column in ARKit-named data (`browDownLeft`, ...); -1 if absent."""
    columns = {name: column for column, name in enumerate(names)}
    result = []
    for name in RIG_NAMES:
        stem, side = (name[:-2], name[-1]) if name[-2:] in ("_L", "_R") else (name, "")
        suffix = {"L": "Left", "R": "Right", "": ""}[side]
        result.append(columns.get(stem if stem in _SPLIT else stem + suffix, -1))
    return result


def from_arkit(weights: np.ndarray, names: list[str]) -> np.ndarray:
    """[T, K] ARKit weights, 0..1 -> [T, 53] rig curves; a channel that is absent stays 0."""
    columns = np.array(arkit_columns(names))
    curves = np.zeros((len(weights), len(RIG_NAMES)), np.float32)
    present = columns >= 0
    curves[:, present] = weights[:, columns[present]]
    return curves
