"""Creases of the expression in a photograph, which are not in the skin at rest."""

import numpy as np
from scipy.ndimage import gaussian_filter, maximum_filter

from render import wrinkles
from render.avatars import scan_texture
from render.avatars.maker import Maker
from render.avatars.photos.colors.complete import anchors
from render.avatars.photos.colors.light import DARK, around
from render.avatars.textures import SIZE
from render.types import Doubles, Floats

DEEP = 0.12  # darkness of a wrinkle's map at which all of a crease is taken off
AROUND_TEXELS, SOFT_TEXELS = 9, 3.0  # a person's creases lie beside everyone's
WIDE_TEXELS = 9.0  # skin beside a crease


def folded(maker: Maker, rigs: list[Doubles]) -> list[Doubles]:  # [R] activations -> [T] 0..1
    """Where expressions fold the skin."""
    side, dark = wrinkles.side(anchors(maker)[:, 0])[:, None], list[Floats]()
    for rig in rigs:
        of_rig = wrinkles.rig_map(maker.rig_names, len(rig))
        left, right = np.split(wrinkles.amounts(rig.astype(np.float32), of_rig), 2)
        dark.append(np.maximum(maker.wrinkles * (side * left + (1 - side) * right), 0).max(1))
    deep = np.clip(scan_texture.over_atlas(maker, np.stack(dark, 1)) / DEEP, 0, 1)
    pictures = deep.T.reshape(-1, SIZE, 2 * SIZE)
    wide = [maximum_filter(one, AROUND_TEXELS).astype(np.float64) for one in pictures]
    return [gaussian_filter(one, SOFT_TEXELS).ravel() for one in wide]


def smoothed(color: Doubles, weight: Doubles, fold: Doubles) -> Doubles:  # [T, 3], [T], [T]
    """No darker there than the skin around."""
    bright = np.log(color.mean(1) + DARK).reshape(SIZE, 2 * SIZE, 1)
    lighter = around(bright, weight.reshape(bright.shape), WIDE_TEXELS, bright) - bright
    return color * np.exp(fold * np.maximum(lighter, 0).ravel())[:, None]
