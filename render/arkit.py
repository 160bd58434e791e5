"""The fixed linear map between the rig and the 52 ARKit blendshapes, and Live Link Face tables.

The rig has every ARKit shape but tongueOut, and two sides of browInnerUp and cheekPuff.
"""

from functools import lru_cache
from pathlib import Path

import numpy as np

from render.types import Floats
from sensors import livelink_table
from sensors.types import InputError

_SIDED = (
    *("eyeBlink", "eyeLookDown", "eyeLookIn", "eyeLookOut", "eyeLookUp", "eyeSquint", "eyeWide"),
    *("mouthSmile", "mouthFrown", "mouthDimple", "mouthStretch", "mouthPress", "mouthLowerDown"),
    *("mouthUpperUp", "browDown", "browOuterUp", "cheekSquint", "noseSneer"),
)
_SINGLE = (
    *("jawForward", "jawLeft", "jawRight", "jawOpen", "mouthClose", "mouthFunnel", "mouthPucker"),
    *("mouthLeft", "mouthRight", "mouthRollLower", "mouthRollUpper", "mouthShrugLower"),
    *("mouthShrugUpper", "browInnerUp", "cheekPuff", "tongueOut"),
)
NAMES = sorted([*(f"{n}{s}" for n in _SIDED for s in ("Left", "Right")), *_SINGLE])


def matrix(rig_names: list[str]) -> Floats:  # [52, 53]
    """rig = arkit @ matrix; back, split sides give their mean."""
    return _forth(tuple(rig_names))


@lru_cache
def _forth(rig_names: tuple[str, ...]) -> Floats:
    out = np.zeros((len(NAMES), len(rig_names)), np.float32)
    for row, name in enumerate(NAMES):
        sided = name.removesuffix("Left") + "_L" if name.endswith("Left") else ""
        sided = name.removesuffix("Right") + "_R" if name.endswith("Right") else sided
        options = {sided} if _is_sided(name) else {name, f"{name}_L", f"{name}_R"}
        for column, rig_name in enumerate(rig_names):
            if rig_name in options:
                out[row, column] = 1
    return out


def _is_sided(name: str) -> bool:
    return any(name in (f"{n}Left", f"{n}Right") for n in _SIDED)


def to_rig(arkit: Floats, rig_names: list[str]) -> Floats:  # [..., 52] -> [..., 53]
    return arkit.astype(np.float32) @ matrix(rig_names)


def from_rig(rig: Floats, rig_names: list[str]) -> Floats:  # [..., 53] -> [..., 52]
    return rig.astype(np.float32) @ _back(tuple(rig_names))


@lru_cache
def _back(rig_names: tuple[str, ...]) -> Floats:  # [53, 52]
    forth = _forth(rig_names)
    return (forth / np.maximum(forth.sum(1, keepdims=True), 1)).T


def read_live_link(path: Path) -> Floats:  # [T, 52]
    """Weights of a Live Link Face table in the order of NAMES; rows without a face are dropped.

    Raises InputError where it is no such table, or has no face.
    """
    weights = livelink_table.read(path, NAMES, livelink_table.WEIGHTS).values.astype(np.float32)
    if not len(weights):
        raise InputError(f"{path}: expected a row with a face, got none; record the take anew")
    return weights
