"""Beards, procedural: stubble in the skin's own colour, and strands that stand on it.

Where a beard grows is painted on the mean face in millimetres. Strands start upright, lie down
along the flow of a beard (down the cheeks and the chin, outward over the lips) and are drawn as
thin Gaussians.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from render.avatars.maker import Maker
from render.decoder import beard as beards
from render.decoder import mesh_parts
from render.decoder.beard import Beard
from render.decoder.mesh_parts import SKIN_VERTICES
from render.training.geometry.assembly import Assembly
from render.types import Floats

Tint = tuple[float, float, float]
# Of stored red, green and blue, what roots under a shaven skin take away; how even their shade is.
SHADOW, EVEN = np.array([0.38, 0.41, 0.36], np.float32), 0.6
UPRIGHT = 0.55  # how much of its first segment a strand stands off the skin; halved in each next
RADII_MM = (0.22, 0.13)  # of the pieces of a strand: a few hairs
SPREAD = 0.3  # how much strands differ in length and brightness
CURL = 0.3  # how far strands leave the flow, most of it together with their tuft
TUFT = 12  # strands in a tuft
SHORTEST = 0.35  # of the full length, where a beard begins
LIP_MM = -36.0  # height of the mouth; strands above it belong to a moustache
FULL = 2.0  # strands stand closer than the stubble is dark at the edge of a beard
MOUSTACHE = 2.0  # strands of a moustache stand closer
EARS_MM = 12.0  # strands grow in front of them


@dataclass(frozen=True)
class BeardStyle:
    """How a beard is worn."""

    count: int
    length_mm: float
    cheeks: float = 1.0  # 0: moustache and chin alone
    thickness: float = 1.0  # of its strands
    roots: float = 1.0  # how far they colour the skin
    segments: int = 2  # Gaussians along a strand: 1 or 2


def area(assembly: Assembly, used: NDArray[np.int32], cheeks: float = 1.0) -> Floats:  # [U] 0..1
    """Where a beard grows: from the sideburns down to the jaw's edge and along the upper lip."""
    v = assembly.face.neutral
    x, y, z = np.abs(v[used, 0]), v[used, 1], v[used, 2]
    lips = np.isin(used, bare(assembly))
    upper = -14 + 0.55 * np.clip(x - 30, 0, None) - 0.3 * np.clip(30 - x, 0, 12)
    lower = -112 + 0.75 * np.clip(x - 15, 0, None)  # the throat stays clear
    soft = np.clip((upper - y) / 10, 0, 1) * np.clip((y - lower) / 14, 0, 1)
    soft *= np.clip((z + 5) / 25, 0, 1) * (used < SKIN_VERTICES) * ~lips  # not on the ears
    cheek = np.clip((x - 24) / 12, 0, 1) * np.clip((y + 52) / 20, 0, 1)
    soft *= 1 - 0.6 * cheek * np.clip((72 - x) / 16, 0, 1)
    soft *= 1 - (1 - cheeks) * np.clip((x - 22) / 10, 0, 1)
    return soft.astype(np.float32)


def bare(assembly: Assembly) -> NDArray[np.int32]:
    """Vertices of the lips and behind them: no strand stands on a triangle that touches these."""
    names = "lips", "inner_mouth_lip_roll", "mouth_socket"
    return np.concatenate([assembly.face.regions[name] for name in names])


def where(assembly: Assembly, maker: Maker) -> Floats:  # [N]
    """How far each Gaussian is on skin where a beard grows."""
    mask = maker.surface.interpolate @ area(assembly, maker.surface.used)
    kinds = assembly.kinds[maker.anchor_triangles]
    mask[kinds != mesh_parts.SKIN] = 0
    return mask.astype(np.float32)


def stubble(
    assembly: Assembly,
    maker: Maker,
    albedo: Floats,
    strength: float,
    rng: np.random.Generator,
) -> Floats:
    """Darker skin in grains as large as a Gaussian: cool, as roots under skin look, and even."""
    if strength == 0:
        return albedo
    mask = where(assembly, maker)
    grain = np.clip(0.85 + 0.22 * rng.standard_normal(len(mask)), 0.3, 1.3)
    cover = np.clip(strength * mask**EVEN * grain, 0, 1)[:, None].astype(np.float32)
    return (albedo * (1 - cover * SHADOW)).astype(np.float32)


def grow(
    assembly: Assembly,
    maker: Maker,
    vertices: Floats,  # [V, 3] mm at rest
    style: BeardStyle,
    tint: Tint,
    rng: np.random.Generator,
) -> Beard:
    """Strands for one person: roots by area, lit as part of the head at rest."""
    corners, shares, full = _roots(assembly, maker, vertices, style, rng)
    roots = (vertices[corners] * shares[..., None]).sum(1)
    frames = beards.frames(vertices, corners)
    normal = frames[..., 2]
    down = _lie(roots, normal, rng)
    # a moustache is denser than a full beard, not longer
    length = style.length_mm * (SHORTEST + (1 - SHORTEST) * np.minimum(full, 1))
    length = length * np.clip(1 + SPREAD * rng.standard_normal(style.count), 0.5, 1.5)
    over_lip = _over_lip(roots)
    length[over_lip] = np.minimum(length[over_lip], 0.5 * np.abs(roots[over_lip, 1] - LIP_MM))
    bright = np.clip(1 + SPREAD * rng.standard_normal((style.count, 1)), 0.6, 1.5)
    places = (roots.astype(np.float32), np.ascontiguousarray(normal, np.float32))
    seen = maker.occlusion(vertices, normal, points=places, offset_mm=2.0)
    lines, upright, step = [roots], UPRIGHT, (length / style.segments)[:, None]
    for _ in range(style.segments):
        along = upright * normal + (1 - upright) * down
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        lines.append(lines[-1] + step * along)
        upright *= 0.5
    radii = np.array(RADII_MM[: style.segments], np.float32)
    widths = np.tile(style.thickness * radii, (style.count, 1))
    opacities = np.repeat(np.clip(0.3 + 0.45 * full, 0, 0.75)[:, None], style.segments, 1)
    color = np.clip((np.array(tint) * bright) ** 2, 0, 1).astype(np.float32)
    points = np.stack(lines, 1).astype(np.float32)
    return beards.attached(points, widths, corners, vertices, opacities, color, seen)


def _roots(
    assembly: Assembly, maker: Maker, vertices: Floats, style: BeardStyle, rng: np.random.Generator
) -> tuple[NDArray[np.int32], Floats, Floats]:
    """Triangles [n, 3], places on them [n, 3], and how much of a beard grows there [n] 0..1."""
    cover = np.zeros(len(vertices), np.float32)
    cover[maker.surface.used] = area(assembly, maker.surface.used, style.cheeks)
    skin = assembly.face.faces[assembly.kinds == mesh_parts.SKIN]
    share = np.clip(FULL * cover[skin].mean(1), 0, 1)
    share *= np.clip((vertices[skin, 2].mean(1) - EARS_MM) / 18, 0, 1)
    share[_over_lip(vertices[skin].mean(1))] *= MOUSTACHE
    share[np.isin(skin, bare(assembly)).any(1)] = 0
    skin, share = skin[share > 0.02], share[share > 0.02]
    a, b, c = (vertices[skin[:, k]] for k in range(3))
    weight = share * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    chosen = rng.choice(len(skin), style.count, p=weight / weight.sum())
    u, v = rng.uniform(0, 1, (2, style.count))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    shares = np.stack([1 - u - v, u, v], 1).astype(np.float32)
    return skin[chosen], shares, share[chosen]


def _lie(roots: Floats, normal: Floats, rng: np.random.Generator) -> Floats:  # -> [n, 3] unit
    """The way each strand lies on the skin: along the flow, astray mostly as its tuft is."""
    tufts = rng.integers(len(roots), size=len(roots) // TUFT)
    tuft = KDTree(roots[tufts]).query(roots)[1]
    stray = rng.standard_normal((len(tufts), 3))[tuft] + 0.6 * rng.standard_normal(roots.shape)
    down = flow(roots, normal) + CURL * stray
    down -= (down * normal).sum(1, keepdims=True) * normal
    return down / (np.linalg.norm(down, axis=1, keepdims=True) + 1e-9)


def _over_lip(roots: Floats) -> NDArray[np.bool_]:  # [n, 3] -> [n]
    """Strands of a moustache."""
    return (roots[:, 1] > LIP_MM) & (np.abs(roots[:, 0]) < 30)


def flow(roots: Floats, normal: Floats) -> Floats:  # [n, 3], [n, 3] -> [n, 3]
    """The way a beard lies: down, back along the cheeks, outward above the mouth."""
    x, y = roots[:, 0], roots[:, 1]
    above = _over_lip(roots).astype(np.float32)
    side = np.sign(x) * np.clip(np.abs(x) / 10, 0.2, 1)
    way = np.stack([above * side * 1.2, -np.ones_like(y), 0.25 * (1 - above)], 1)
    return way - (way * normal).sum(1, keepdims=True) * normal
