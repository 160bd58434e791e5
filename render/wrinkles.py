"""Wrinkles that come and go with the expression: dark folds, and the skin beside them that is lit.

Four kinds, of either side of the face: across the forehead when brows rise, between the brows in a
frown, beside squinting eyes, and from the nose to the corners of the mouth. What they do to the
brightness is a map in the skin's texture (`render/training/look/wrinkles.py`), the same for
everyone; an expression says how much of each is seen. The mesh renderer reads the same maps.
"""

# pyright: reportUntypedFunctionDecorator=false
from dataclasses import dataclass

import numpy as np
from numba import njit

from render.types import Floats, Ints

# Share of a kind that an activation of its side brings out in full.
KINDS: tuple[dict[str, float], ...] = (
    {"browInnerUp": 0.65, "browOuterUp": 0.65},
    {"browDown": 0.9, "noseSneer": 0.4},
    {"mouthSmile": 0.45, "cheekSquint": 0.7, "eyeSquint": 0.6},
    {"mouthSmile": 0.8, "noseSneer": 0.6, "mouthUpperUp": 0.3, "mouthDimple": 0.3},
)
SIDES = "LR"
ACROSS_MM = np.float32(8.0)  # of the middle of the face, where one side becomes the other
TINT = np.array([0.75, 1.05, 1.1], np.float32)  # folds are red: less of it is taken away
STEPS = 256  # in a file, a whole
LEAST = np.float32(0.004)  # of a map: what changes less is left as it is


@dataclass(frozen=True)
class Wrinkles:
    """Which Gaussians they reach."""

    rows: Ints  # [n] of the Gaussians
    maps: Floats  # [n, 8] how much darker: kinds on the left side, on the right one
    from_rig: Floats  # [R, 8]

    def fold(self, rig: Floats, colors: Floats, deep: float) -> None:
        """Darken colours [N, 3] where an expression [R] folds the skin, in place; `deep`: how
        deep a person's wrinkles are."""
        most = np.float32(deep) * amounts(rig, self.from_rig)
        if most.any():
            darken(self.rows, self.maps, most, TINT, colors)


def build(
    maps: Floats,  # [N, 4] of each Gaussian
    across: Floats,  # [N] mm, to the left, on the mean face
    names: list[str],  # of the rig
    size: int,  # R
) -> Wrinkles:
    left = side(across)[:, None]
    both = np.concatenate([maps * left, maps * (1 - left)], 1).astype(np.float32)
    rows = np.flatnonzero(np.abs(maps).max(1) > LEAST).astype(np.int32)
    return Wrinkles(rows, np.ascontiguousarray(both[rows]), rig_map(names, size))


def rig_map(names: list[str], size: int) -> Floats:  # [R, 8]
    """Activations -> how much of each kind on the left, on the right."""
    out = np.zeros((size, len(SIDES) * len(KINDS)), np.float32)
    for column, (of_side, kind) in enumerate((s, k) for s in SIDES for k in KINDS):
        for name, share in kind.items():
            out[names.index(f"{name}_{of_side}"), column] = share
    return out


def amounts(rig: Floats, from_rig: Floats) -> Floats:  # [R], [R, 8] -> [8] 0..1
    """How much of each kind an expression brings out."""
    return np.clip(rig @ from_rig, 0, 1).astype(np.float32)


def side(across: Floats) -> Floats:  # mm -> 0 right .. 1 left
    share = np.clip(across / (2 * ACROSS_MM) + 0.5, 0, 1)
    return (share * share * (3 - 2 * share)).astype(np.float32)


@njit(cache=True, nogil=True, error_model="numpy")
def darken(rows: Ints, maps: Floats, amounts: Floats, tint: Floats, colors: Floats) -> None:
    """[n], [n, K], [K], [3], [N, 3]: colours times 1 - tint (maps @ amounts)."""
    zero, one = np.float32(0), np.float32(1)
    for i in range(len(rows)):
        deep = zero
        for k in range(len(amounts)):
            deep += maps[i, k] * amounts[k]
        row = np.uintp(rows[i])
        for c in range(3):
            colors[row, c] = min(colors[row, c] * (one - tint[c] * deep), one)
