"""Maps of wrinkles in the skin's texture: how much darker the four kinds of
`render/wrinkles.py` make it; below zero: lit.

Light comes from above: under a dark fold lies a flank that is lit.
"""

import numpy as np
from numpy.typing import NDArray

from render.training.look.places import Places, soft
from render.training.look.relief import noise
from render.types import Floats
from render.wrinkles import TINT

Array = NDArray[np.floating]
FOREHEAD_MM = ((66.5, 0.7), (73.5, 1.0), (80.5, 0.9), (87.5, 0.5))  # heights of lines, how deep
FROWN_MM = ((6.0, 38.0, 60.0), (0.8, 40.0, 56.0))  # off the middle at their foot, from, up to
CORNER_MM, RAYS_DEG = (46.0, 33.0), (-34, -10, 14, 36)  # of the eye; of rays out of it
FOLD_MM = ((17.0, 3.0), (23.0, -9.0), (29.0, -21.0), (33.0, -33.0), (34.0, -41.0))  # x, y
ONE_SIDED = 0.3  # share of unevenness that the sides do not have in common
LEAST, GROWTH, AT_REST = 0.6, 1.0, 0.75  # depth when young, more when old; and that of a calm face
DEPTH = (0.15, 0.16, 0.14, 0.22)  # of stored brightness, where a fold is deepest


def depth(age: float) -> float:
    """How deep a person's wrinkles are, 1 a little before middle age; age 0 young .. 1 old."""
    return LEAST + GROWTH * age


def at_rest(albedo: Floats, maps: Floats, age: float) -> Floats:  # [N, 3], [N, 4] -> [N, 3]
    """The albedo with what age leaves of the wrinkles in a calm face."""
    deep = AT_REST * age**2 * maps.sum(1, keepdims=True)
    return np.clip(albedo * (1 - TINT * deep), 0, 1).astype(np.float32)


def maps(places: Places) -> Floats:  # [SIZE, SIZE, 4]
    """As deep as a face of middle age has them."""
    points = places.points
    mirrored = np.concatenate([places.across[..., None], points[..., 1:]], -1)
    uneven = noise(mirrored, 26, 41, 1) + ONE_SIDED * noise(points, 26, 43, 1)
    on = soft((places.face > 0.5).astype(np.float32), 4) * (places.points[..., 2] > 20)
    kinds = (_forehead(places, uneven), _frown(places), _rays(places, uneven), _fold(places))
    depths = zip(DEPTH, kinds, strict=True)
    return np.stack([on * depth * kind for depth, kind in depths], -1).astype(np.float32)


def _line(off: Array, width: float) -> Array:
    """A fold by the distance above its middle, mm: dark, and lit below."""
    return np.exp(-((off / width) ** 2)) - 0.45 * np.exp(-(((off + 1.9 * width) / width) ** 2))


def _forehead(places: Places, uneven: Array) -> Array:
    height = places.up + 1.3 * uneven + 0.0035 * places.across**2
    out = np.zeros_like(height)
    for middle, deep in FOREHEAD_MM:
        broken = np.clip(0.85 + 0.25 * np.roll(uneven, int(middle)), 0.4, 1)
        out += deep * broken * _line(height - middle, 1.7)
    return out * np.clip((46 - places.across) / 16, 0, 1)


def _frown(places: Places) -> Array:
    out = np.zeros_like(places.up)
    for foot, low, high in FROWN_MM:
        share = np.clip((places.up - low) / (high - low), 0, 1)
        middle = foot + 2.0 * share**2
        end = np.clip(6 * share * (1 - share), 0, 1)
        deep = 1.0 if foot > 2 else 0.35
        out += deep * end * np.exp(-(((places.across - middle) / 1.8) ** 2))
        out -= 0.35 * deep * end * np.exp(-(((places.across - middle - 3.2) / 2.0) ** 2))
    root = np.clip(1 - (places.across / 11) ** 2, 0, 1)
    return out + 0.7 * root * _line(places.up - 29 - 0.02 * places.across**2, 1.7)


def _rays(places: Places, uneven: Array) -> Array:
    x, y = places.across - CORNER_MM[0], places.up - CORNER_MM[1]
    away, around = np.hypot(x, y), np.degrees(np.arctan2(y, x)) + 5 * uneven
    out = np.zeros_like(x)
    for ray in RAYS_DEG:
        off = away * np.sin(np.radians(np.clip(around - ray, -90, 90)))
        out += _line(off, 1.3) * (np.abs(around - ray) < 60)
    out *= np.clip((away - 3.5) / 3, 0, 1) * np.clip((19 - away) / 9, 0, 1)
    # two fine lines below the lower lid
    under = places.up - 33 + 0.012 * (places.across - 31) ** 2
    lids = np.clip(1 - ((places.across - 33) / 15) ** 2, 0, 1)
    return out + 0.5 * lids * (_line(under + 9.0, 1.3) + 0.7 * _line(under + 13.0, 1.3))


def _fold(places: Places) -> Array:
    """Soft, beside a line from the wing of the nose past the corner of the mouth."""
    x, y = np.array(FOLD_MM).T
    middle = np.interp(places.up, y[::-1], x[::-1])
    along = np.clip((y[0] - places.up) / (y[0] - y[-1]), 0, 1)
    end = np.clip(5 * along * (1 - along), 0, 1) * ((places.up < y[0]) & (places.up > y[-1]))
    slope = np.hypot(1, np.gradient(x, y)).mean()
    off = (places.across - middle) / slope
    dark = np.exp(-((off / 1.7) ** 2)) + 0.4 * np.exp(-(((off + 2.2) / 3.2) ** 2))
    return end * (dark - 0.4 * np.exp(-(((off - 4.0) / 3.2) ** 2)))
