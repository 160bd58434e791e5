"""The light on the head: one model for the mesh renderer (GLSL) and for the decoder (numpy).

A key light (with a shadow), a fill, a rim and a sky. Skin is wrapped: red light bleeds around the
terminator, which is what scattering under the skin does at portrait distance. Linear light is the
square of a stored colour (gamma 2): a square root is the cheapest way back.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from render import kernels

Floats = NDArray[np.float32]
WRAP = np.array([0.30, 0.16, 0.12], np.float32)  # how far red, green, blue reach into the shade
BOUNCE = np.float32(0.20)  # share of the sky that reaches even a mouth, from skin to skin
VIEWER = np.array([0.0, 0.0, 1.0])  # shine is baked for someone in front of the face


def _unit(*xyz: float) -> Floats:
    v = np.array(xyz, np.float64)
    return (v / np.linalg.norm(v)).astype(np.float32)


KEY = _unit(0.42, 0.55, 0.80)
FILL = _unit(-0.75, 0.15, 0.65)
RIM = _unit(-0.55, 0.45, -0.80)
SKIN_SHINE, EYE_SHINE, WET_SHINE = (0.045, 0.0), (0.02, 0.0), (0.0, 0.10)  # soft, gloss
HALF = _unit(*(KEY + VIEWER))  # where the key light mirrors towards the viewer
TOWARDS = np.stack([FILL, RIM, KEY, HALF])  # [4, 3]


@dataclass(frozen=True)
class Lighting:
    """Colours of the lights, linear; the directions are those of the head and do not change."""

    key: tuple[float, float, float] = (0.88, 0.82, 0.76)
    fill: tuple[float, float, float] = (0.20, 0.22, 0.26)
    rim: tuple[float, float, float] = (0.16, 0.18, 0.22)
    sky: tuple[float, float, float] = (0.30, 0.31, 0.33)
    ground: tuple[float, float, float] = (0.20, 0.17, 0.15)

    def parts(self, normals: Floats, gains: Floats | None = None) -> Floats:
        """[n, 3] unit, [n, 3] of linear light -> [n, 8], on a white surface that sees all of it.

        0..2 from sky, fill and rim, 3..5 from the key light; 6 sheen of skin (power 16), 7 gloss
        of wet surfaces (power 64).
        """
        gains = np.ones_like(normals) if gains is None else gains
        out = np.empty((len(normals), 8), np.float32)
        kernels.receive(normals, gains, TOWARDS, *self.terms, out)
        return out

    @cached_property
    def terms(self) -> tuple[Floats, Floats]:  # [3, 3, 2], [3, 2]
        """Gain and offset over the cosine: of each lamp and channel, of the sky."""
        gains = np.array([self.fill, self.rim, self.key], np.float32) / (1 + WRAP)
        up, down = np.array(self.sky, np.float32), np.array(self.ground, np.float32)
        half = np.float32(0.5)
        return np.stack([gains, gains * WRAP], 2), half * np.stack([up - down, up + down], 1)

    def shade(
        self,
        normals: Floats,  # [n, 3] unit
        ambient: Floats,  # [n] 0..1 share of the sky that is seen
        lit: Floats,  # [n] 0..1 share of the key light that is seen
    ) -> Floats:  # [n, 3] linear light on a white surface
        """What the fragment shader computes too (shaders/mesh.frag.glsl)."""
        parts = self.parts(normals)
        sky = BOUNCE + (1 - BOUNCE) * ambient
        light = parts[:, :3] * sky[:, None] + parts[:, 3:6] * lit[:, None]
        return light.astype(np.float32)


STUDIO = Lighting()
LIGHTINGS = {
    "studio": STUDIO,
    "window": Lighting(
        (0.66, 0.72, 0.82),
        (0.30, 0.28, 0.26),
        (0.08, 0.08, 0.08),
        (0.36, 0.38, 0.42),
        (0.24, 0.24, 0.24),
    ),
    "warm": Lighting(
        (1.0, 0.80, 0.60),
        (0.12, 0.15, 0.24),
        (0.3, 0.22, 0.15),
        (0.22, 0.22, 0.22),
        (0.2, 0.15, 0.1),
    ),
}
