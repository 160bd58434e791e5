"""The light on the head: one model for the mesh renderer (GLSL) and for the decoder (numpy).

A key light (with a shadow), a fill, a rim and a sky. Skin is wrapped: red light bleeds around the
terminator, which is what scattering under the skin does at portrait distance. Linear light is the
square of a stored colour (gamma 2): a square root is the cheapest way back.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]
WRAP = np.array([0.30, 0.16, 0.12], np.float32)  # how far red, green, blue reach into the shade
BOUNCE = 0.20  # share of the sky that reaches even a mouth, from skin to skin
VIEWER = np.array([0.0, 0.0, 1.0])  # shine is baked for someone in front of the face


def _unit(*xyz: float) -> Floats:
    v = np.array(xyz, np.float64)
    return (v / np.linalg.norm(v)).astype(np.float32)


KEY = _unit(0.42, 0.55, 0.80)
FILL = _unit(-0.75, 0.15, 0.65)
RIM = _unit(-0.55, 0.45, -0.80)
TOWARDS = np.stack([FILL, RIM, KEY], 1)  # [3, 3] a column a light
SKIN_SHINE, EYE_SHINE, WET_SHINE = (0.045, 0.0), (0.02, 0.0), (0.0, 0.10)  # soft, gloss
HALF = _unit(*(KEY + VIEWER))  # where the key light mirrors towards the viewer


@dataclass(frozen=True)
class Lighting:
    """Colours of the lights, linear; the directions are those of the head and do not change."""

    key: tuple[float, float, float] = (0.88, 0.82, 0.76)
    fill: tuple[float, float, float] = (0.20, 0.22, 0.26)
    rim: tuple[float, float, float] = (0.16, 0.18, 0.22)
    sky: tuple[float, float, float] = (0.30, 0.31, 0.33)
    ground: tuple[float, float, float] = (0.20, 0.17, 0.15)

    def parts(self, normals: Floats) -> tuple[Floats, Floats]:
        """Light on a white surface [3, n] unit normals -> from sky, fill and rim; from the key.

        Channels first: numpy is ten times faster on whole rows.
        """
        fill, rim, key = TOWARDS.T @ normals
        sky, lamp = np.empty_like(normals), np.empty_like(normals)
        term = np.empty_like(fill)
        for k in range(3):
            up, down, total = self.sky[k], self.ground[k], sky[k]
            np.multiply(normals[1], np.float32(0.5 * (up - down)), out=total)
            total += np.float32(0.5 * (up + down))
            total += _wrapped(fill, self.fill[k], WRAP[k], term)
            total += _wrapped(rim, self.rim[k], WRAP[k], term)
            _wrapped(key, self.key[k], WRAP[k], lamp[k])
        return sky, lamp

    def shade(
        self,
        normals: Floats,  # [3, n] unit
        ambient: Floats,  # [n] 0..1 share of the sky that is seen
        lit: Floats,  # [n] 0..1 share of the key light that is seen
    ) -> Floats:  # [3, n] linear light on a white surface
        """What the fragment shader computes too (shaders/mesh.frag.glsl)."""
        return shaded(*self.parts(normals), ambient, lit)


def shaded(sky: Floats, lamp: Floats, ambient: Floats, lit: Floats) -> Floats:
    """Both parts of the light [3, n] under what is seen of them [n] -> [3, n]."""
    out = sky * (np.float32(BOUNCE) + np.float32(1 - BOUNCE) * ambient)
    out += lamp * lit
    return out.astype(np.float32, copy=False)


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


def shine(normals: Floats) -> tuple[Floats, Floats]:  # [3, n] -> [n], [n]
    """Sheen of skin (power 16) and gloss of wet surfaces (power 64), for a weight of 1."""
    facing = np.maximum(HALF @ normals, np.float32(0.5))  # no denormals in its powers: slow
    facing *= facing  # ^2
    facing *= facing
    facing *= facing  # ^8
    soft = facing * facing  # ^16
    gloss = soft * soft
    return soft, gloss * gloss


def _wrapped(cosine: Floats, color: float, wrap: np.float32, out: Floats) -> Floats:  # [n] -> [n]
    gain = np.float32(color) / (1 + wrap)
    np.multiply(cosine, gain, out=out)
    out += gain * wrap
    return np.maximum(out, 0, out=out)
