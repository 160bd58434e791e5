"""The light on the head: one model for the mesh renderer (GLSL) and for the decoder (numba).

A key light in a large soft box (with a shadow), a fill, two rims from behind and a sky. Skin is
wrapped and its shadows are edged with red: light bleeds under it. What is stored and blended is
the picture of a film: linear light through a curve with a toe and a shoulder, then a square root.
"""

# pyright: reportUntypedFunctionDecorator=false
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit

from render.types import Floats

WRAP = np.array([0.24, 0.12, 0.08], np.float32)  # how far red, green, blue reach into the shade
BLEED = np.array([0.45, -0.04, -0.12], np.float32)  # more of them where half the light is seen
BOUNCE = np.array([0.12, 0.075, 0.065], np.float32)  # of the sky, seen even inside a mouth
SHEEN = np.float32(0.35)  # share of the rims' light that skin mirrors: down catches what is so flat
EXPOSURE = 0.85
LUMINANCE = np.array([0.3, 0.59, 0.11], np.float32)  # how bright red, green, blue are seen
# x (a x + b) / (x (c x + d) + e): Narkowicz's fit of the ACES curve, at that exposure
FILM = np.array([2.51, 0.03 / EXPOSURE, 2.43, 0.59 / EXPOSURE, 0.14 / EXPOSURE**2], np.float32)


@dataclass(frozen=True, eq=False)
class Lamp:
    """A soft box far away; in the head's frame."""

    towards: Floats  # [3] unit
    half_width: float  # tangent of the angle


def _lamp(x: float, y: float, z: float, half_width: float) -> Lamp:
    v = np.array((x, y, z), np.float64)
    return Lamp((v / np.linalg.norm(v)).astype(np.float32), half_width)


KEY, FILL = _lamp(0.62, 0.52, 0.78, 0.32), _lamp(-0.85, 0.10, 0.62, 0.55)
RIM_LEFT, RIM_RIGHT = _lamp(0.88, 0.25, -0.50, 0.25), _lamp(-0.80, 0.42, -0.95, 0.30)
LAMPS = (KEY, FILL, RIM_LEFT, RIM_RIGHT)
TOWARDS = np.stack([lamp.towards for lamp in LAMPS])  # [4, 3]
TOWARDS_AND_UP = np.concatenate([TOWARDS, [[0, 1, 0]]]).astype(np.float32)  # [5, 3]
HALF_WIDTHS = np.array([lamp.half_width for lamp in LAMPS], np.float32)
RGB = tuple[float, float, float]


@dataclass(frozen=True)
class Lighting:
    """Linear light on a white surface that faces each lamp; where lamps stand does not change."""

    key: RGB = (0.76, 0.715, 0.655)
    fill: RGB = (0.115, 0.13, 0.145)
    rim_left: RGB = (0.32, 0.29, 0.25)
    rim_right: RGB = (0.44, 0.50, 0.54)
    sky: RGB = (0.150, 0.160, 0.170)
    ground: RGB = (0.085, 0.075, 0.070)

    @cached_property
    def colors(self) -> Floats:  # [4, 3] of LAMPS
        return np.array([self.key, self.fill, self.rim_left, self.rim_right], np.float32)

    @cached_property
    def terms(self) -> tuple[Floats, Floats]:  # [4, 3, 2], [3, 2]
        """Gain and offset over the cosine: of each lamp and channel, of the sky."""
        gains = self.colors / (1 + WRAP)
        up, down = np.array(self.sky, np.float32), np.array(self.ground, np.float32)
        half = np.float32(0.5)
        return np.stack([gains, gains * WRAP], 2), half * np.stack([up - down, up + down], 1)

    def parts(
        self, normals: Floats, gains: Floats | None = None, turn: Floats | None = None
    ) -> Floats:
        """[n, 3] unit, [n, 3] of linear light, [3, 3] how the head turns -> [n, 12], on a white
        surface that sees all of it.

        0..2 from sky and fill, 3..5 from the key light, 6..8 and 9..11 from the rims.
        """
        gains = np.ones_like(normals) if gains is None else gains
        out = np.empty((len(normals), 12), np.float32)
        towards = TOWARDS_AND_UP if turn is None else TOWARDS_AND_UP @ turn  # lamps, turned back
        light_vertices(normals, gains, towards, *self.terms, out)
        return out

    def shade(self, normals: Floats, seen: Floats) -> Floats:
        """[n, 3] unit, [n, 4] shares that are seen -> [n, 3] linear light on a white surface:
        what the fragment shader computes too (shaders/mesh.frag.glsl)."""
        parts = self.parts(normals).reshape(-1, 4, 3)
        shares = seen[:, :, None] * (1 + BLEED * (1 - seen[:, :, None]))
        shares[:, 0] = BOUNCE + (1 - BOUNCE) * shares[:, 0]
        return (parts * shares).sum(1).astype(np.float32)


def developed(linear: Floats) -> Floats:
    """Linear light -> stored values, 0..1."""
    a, b, c, d, e = FILM
    x = np.maximum(linear, 0)
    return np.sqrt(np.clip(x * (a * x + b) / (x * (c * x + d) + e), 0, 1)).astype(np.float32)


def exposed(stored: Floats) -> Floats:
    """Stored values -> linear light: undoes `developed`."""
    a, b, c, d, e = FILM
    r = stored * stored
    p, q = a - c * r, b - d * r
    return ((np.sqrt(q * q + 4 * p * e * r) - q) / (2 * p)).astype(np.float32)


@njit(cache=True, nogil=True, error_model="numpy")
def light_vertices(
    normals: Floats,  # [n, 3] unit
    gains: Floats,  # [n, 3] of linear light
    towards: Floats,  # [5, 3] unit: key, fill, rims left and right, sky
    lamps: Floats,  # [4, 3, 2] of each lamp and channel: gain and offset over the cosine
    sky: Floats,  # [3, 2] the same over the height
    out: Floats,  # -> [n, 12] see Lighting.parts
) -> None:
    zero = np.float32(0)
    for n in range(len(normals)):
        x, y, z = normals[n, 0], normals[n, 1], normals[n, 2]
        height = towards[4, 0] * x + towards[4, 1] * y + towards[4, 2] * z
        for k in range(3):
            out[n, k] = gains[n, k] * (sky[k, 0] * height + sky[k, 1])
        for lamp in range(4):
            cosine = towards[lamp, 0] * x + towards[lamp, 1] * y + towards[lamp, 2] * z
            at = 3 * max(lamp, 1)
            for k in range(3):
                light = max(lamps[lamp, k, 0] * cosine + lamps[lamp, k, 1], zero) * gains[n, k]
                if lamp == 1:
                    out[n, k] += light
                else:
                    out[n, at + k] = light


STUDIO = Lighting()
# A table: each row names all six lights, so that a look can be read, and changed, by itself.
LIGHTINGS = {
    "studio": STUDIO,
    "soft": Lighting(
        key=(0.40, 0.39, 0.38),
        fill=(0.30, 0.30, 0.31),
        rim_left=(0.12, 0.12, 0.12),
        rim_right=(0.12, 0.12, 0.13),
        sky=(0.34, 0.35, 0.36),
        ground=(0.22, 0.20, 0.19),
    ),
    "evening": Lighting(
        key=(0.86, 0.60, 0.36),
        fill=(0.06, 0.08, 0.14),
        rim_left=(0.10, 0.08, 0.06),
        rim_right=(0.26, 0.32, 0.52),
        sky=(0.09, 0.11, 0.17),
        ground=(0.07, 0.05, 0.04),
    ),
    "rim": Lighting(
        key=(0.16, 0.16, 0.17),
        fill=(0.08, 0.09, 0.10),
        rim_left=(1.0, 0.92, 0.82),
        rim_right=(1.0, 1.08, 1.18),
        sky=(0.07, 0.08, 0.09),
        ground=(0.04, 0.04, 0.04),
    ),
}
