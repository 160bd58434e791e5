"""Hair: thin Gaussians along strands, on the head at rest or standing on its moving skin.

A strand scatters light along cones about itself: lit by what crosses it, with a white gloss, a
coloured one that went through it, and a glow when the lamp is behind (after Marschner 2003).
"""

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from render.lighting import TOWARDS, Lighting, developed
from render.types import Density, Floats, Gaussians

DIFFUSE, GLOSS, THROUGH, BEHIND = 0.82, 0.063, 0.70, 1.10  # weights of a lamp's light
SHEEN = 0.04, 0.28  # of rims, on strands that do not lie quite alike: weight, width in rad
SKY = 0.55
CENTRE_MM, FLATTENED = np.array([0.0, 15.0, -8.0], np.float32), 0.85  # of a head; its height
BELOW = 0.35  # of that height: hair below the middle of a head hangs, and faces outward

MOST: dict[Density, int] = {"16k": 18_000, "32k": 18_000}  # Gaussians of hair on thinner heads
THIN_MM = 1.0  # those across which are a strand


@dataclass(frozen=True, eq=False)
class Hair:
    """[H] Gaussians of a head of hair at rest, those that matter most first."""

    means: Floats  # [H, 3] mm
    quats: Floats  # [H, 4] wxyz: x is the strand
    scales: Floats  # [H, 3] mm
    opacities: Floats  # [H]
    albedo: Floats  # [H, 3] stored: the square root of linear
    seen: Floats  # [H, 4] shares of the sky, of the key light and the rims

    def __len__(self) -> int:
        return len(self.means)

    def rows(self, which: slice | NDArray[np.intp]) -> "Hair":
        """Some of them."""
        return Hair(*(getattr(self, f.name)[which] for f in fields(Hair)))

    def of_density(self, density: Density) -> "Hair":
        """What is drawn of it: of thinner heads the first ones, wider: mass and some strands."""
        most, across = MOST.get(density, len(self)), self.scales[:, 1]
        wider = max(len(self) / most, 1) ** 0.5 if most else 1.0
        scales = self.scales.copy()
        scales[:, 1] = np.where(across < THIN_MM, wider * across, across)
        return replace(self, scales=scales).rows(slice(most))

    def lit(self, lights: Lighting) -> Gaussians:
        """As drawn."""
        outward = away(self.means)
        along = axes(self.quats)
        colors = developed(strand_light(along, outward, self.albedo**2, self.seen, lights))
        return Gaussians(self.means, self.quats, self.scales, self.opacities, colors)


def bald() -> Hair:
    shapes = ((0, 3), (0, 4), (0, 3), (0,), (0, 3), (0, 4))
    return Hair(*(np.zeros(shape, np.float32) for shape in shapes))


def joined(parts: list[Hair]) -> Hair:
    """All of them together."""
    names = [f.name for f in fields(Hair)]
    return Hair(*(np.concatenate([getattr(p, name) for p in parts]) for name in names))


def away(points: Floats) -> Floats:  # [n, 3] mm -> [n, 3] unit: out of the head
    out = points - CENTRE_MM
    out[:, 1] *= np.where(out[:, 1] < 0, BELOW, FLATTENED)
    return (out / (np.linalg.norm(out, axis=1, keepdims=True) + 1e-9)).astype(np.float32)


def axes(quats: Floats) -> Floats:  # [n, 4] -> [n, 3] unit: where x is turned to
    w, x, y, z = (quats / (np.linalg.norm(quats, axis=1, keepdims=True) + 1e-9)).T
    columns = (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y))
    return np.stack(columns, 1).astype(np.float32)


def strand_light(
    along: Floats,  # [n, 3] unit
    outward: Floats,  # [n, 3] unit: where each is mostly seen from
    albedo: Floats,  # [n, 3] linear
    seen: Floats,  # [n, 4] shares of the sky, of the key light and the rims
    lights: Lighting,
) -> Floats:  # [n, 3] linear
    """Light that strands give back."""
    up = 0.5 + 0.5 * outward[:, 1:2]
    sky = np.array(lights.ground) + up * (np.array(lights.sky) - np.array(lights.ground))
    out = albedo * sky * (SKY * (0.1 + 0.9 * seen[:, :1])) * np.pi
    to_eye = np.sum(along * outward, 1)
    across_eye = outward - to_eye[:, None] * along
    lean = np.arcsin(np.clip(to_eye, -1, 1))
    for lamp, column in enumerate((1, 0, 2, 3)):
        to_lamp = along @ TOWARDS[lamp]
        across = TOWARDS[lamp] - to_lamp[:, None] * along
        length = np.linalg.norm(across, axis=1) * np.linalg.norm(across_eye, axis=1) + 1e-6
        turn = (across * across_eye).sum(1) / length
        half = 0.5 * (np.arcsin(np.clip(to_lamp, -1, 1)) + lean)
        front = 0.5 + 0.5 * turn
        gloss = np.exp(-(((half - 0.06) / 0.10) ** 2)) * front
        sheen = np.exp(-(((half - 0.06) / SHEEN[1]) ** 2)) * front
        through = np.exp(-(((half + 0.10) / 0.17) ** 2)) * front
        glow = np.exp(-(((half + 0.02) / 0.10) ** 2)) * np.clip(0.5 - 0.5 * turn, 0, 1) ** 3
        crossing = np.sqrt(np.clip(1 - to_lamp**2, 0, 1)) * (0.5 + 0.5 * front)
        facing = np.clip(1.3 * (0.65 * (outward @ TOWARDS[lamp]) + 0.35), 0, 1)
        gloss = GLOSS * gloss + (SHEEN[0] * sheen if lamp > 1 else 0)
        light = DIFFUSE * crossing[:, None] * albedo + gloss[:, None]
        light = light + THROUGH * through[:, None] * albedo**0.75
        light = light + BEHIND * glow[:, None] * albedo**0.6
        out = out + light * (facing * seen[:, column])[:, None] * lights.colors[lamp]
    return out.astype(np.float32)
