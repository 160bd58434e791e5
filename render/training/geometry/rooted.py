"""Hairs that stand on the skin: fine ones before the hairline, and all of a cropped head."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from render.decoder.mesh_parts import SKIN_VERTICES, scattered
from render.strands import Hair
from render.training.geometry.assembly import Assembly
from render.training.geometry.trace import CROWN_MM, strand_quats
from render.types import Floats

# The hairline on the side of the mean face, mm: z, y from the forehead down to the sideburns,
# around the ear, to the nape, and back over the head.
HAIRLINE_MM = (
    (84, 112), (70, 99), (55, 90), (49, 76), (46, 62), (36, 48), (31, 30), (29, 14), (18, 12),
    (16, 26), (10, 40), (-4, 43), (-17, 36), (-22, 18), (-27, -4), (-38, -24), (-52, -34),
    (-300, -34), (-300, 300), (84, 300),
)  # fmt: skip
SOFT_MM = 10.0  # vertices whose cover is averaged
THIN = 1.5  # exponent of cropped hair's density where it ends
BULK, WIDE = 4, 4.0  # strands so near are hair; how far from the cap fine hairs stand
BARE_MM = 6.5  # skin so far from any hair is bare
# Fine hairs by how far from the edge of the hair they stand, mm: inside it none .. all; before it
# all .. none. How uneven that edge is.
INSIDE_MM, BEFORE_MM, UNEVEN_MM = (-16.0, -7.0), (-3.0, 4.5), 3.0
SPREAD = 0.3  # how much hairs differ in length, brightness, direction
LENGTH = 0.45  # standard deviation of a Gaussian along its piece, as a share of it


@dataclass(frozen=True)
class ShortHair:
    """How short hairs are worn."""

    length_mm: float
    pieces: int  # Gaussians of a hair
    width_mm: float  # standard deviation
    rise: float  # off the skin, as a share of the length
    opacity: float
    stray: float = SPREAD  # from the way they lie


FINE, CROP = ShortHair(14.0, 2, 0.12, 0.14, 0.8), ShortHair(4.2, 1, 0.11, 0.30, 0.85)
CURLY = ShortHair(5.0, 2, 0.16, 0.5, 0.85, 2.0)


def head_of_hair(neutral: Floats) -> Floats:  # [SKIN_VERTICES, 3] mm of the mean face -> 0..1
    """Where hair grows, thinner towards the hairline."""
    skin, line = neutral[:SKIN_VERTICES], np.array(HAIRLINE_MM, np.float32)
    z, y = skin[:, 2:], skin[:, 1:2]
    (za, ya), (zb, yb) = line.T, np.roll(line, -1, 0).T
    with np.errstate(divide="ignore", invalid="ignore"):
        crossed = ((ya > y) != (yb > y)) & (z < za + (y - ya) / (yb - ya) * (zb - za))
    return softened(skin, (crossed.sum(1) % 2).astype(np.float32)) ** THIN


def softened(skin: Floats, cover: Floats, reach: float = SOFT_MM) -> Floats:
    """The mean cover [n] around each vertex [n, 3] mm."""
    tree = KDTree(skin)
    for _ in range(2):
        near = tree.query_ball_point(skin, reach)
        cover = np.array([cover[rows].mean() for rows in near], np.float32)
    return cover


def hairs(
    assembly: Assembly,
    vertices: Floats,  # [V, 3] mm at rest
    density: Floats,  # [SKIN_VERTICES] of roots
    flow: Floats,  # [SKIN_VERTICES, 3] the way they lie
    seen: Floats,  # [SKIN_VERTICES, 4] shares of light
    style: ShortHair,
    linear: Floats,  # [3]
    count: int,
    rng: np.random.Generator,
) -> Hair:
    skin = assembly.face.faces[(assembly.face.faces < SKIN_VERTICES).all(1)]
    corners = vertices[skin]
    edges = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(edges, axis=1)
    weight = areas * density[skin].mean(1)
    chosen, shares = scattered(weight, count, rng)
    shares = shares[..., None]
    out = edges[chosen] / areas[chosen, None]
    at, way = ((v[skin[chosen]] * shares).sum(1) for v in (vertices, flow))
    full = (density[skin[chosen]] * shares[..., 0]).sum(1) / density.max()
    way = _flat(way, out)
    way = way + style.stray * rng.normal(0, 1, way.shape)
    way = _flat(way, out)
    length = style.length_mm * (0.35 + 0.65 * full) * rng.lognormal(0, SPREAD, count).clip(0, 1.5)
    step = (length / style.pieces)[:, None]
    color = linear * rng.lognormal(0, SPREAD, (count, 1))
    parts, rise = [], 2 * style.rise
    for piece in range(style.pieces):
        along = way + rise * out
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        thin = style.width_mm * (1 - 0.6 * piece / style.pieces)
        size = np.concatenate([LENGTH * step, np.full((count, 2), thin)], 1)
        parts.append((at + 0.5 * step * along, along, size))
        at, rise = at + step * along, 0.4 * rise
    middles, along, size = (np.concatenate(p).astype(np.float32) for p in zip(*parts, strict=True))
    again = (style.pieces, 1)
    light = (seen[skin[chosen]] * shares).sum(1)
    return Hair(
        middles,
        strand_quats(along, np.tile(out, again)).astype(np.float32),
        size,
        np.tile(style.opacity * np.sqrt(full), style.pieces).astype(np.float32),
        np.tile(np.sqrt(np.clip(color, 0, 1)), again).astype(np.float32),
        np.tile(light, again).astype(np.float32),
    )


def down(vertices: Floats) -> Floats:  # [n, 3] mm -> [n, 3]
    """Away from the crown."""
    return (vertices - CROWN_MM).astype(np.float32)


def _flat(way: NDArray[np.floating], out: Floats) -> NDArray[np.floating]:
    way = way - (way * out).sum(1, keepdims=True) * out
    return way / (np.linalg.norm(way, axis=1, keepdims=True) + 1e-9)


def growing(skin: Floats, cap: Floats) -> Floats:  # [n, 3] mm, [n] 0..1 -> [n] 0..1
    """Where hair grows, with some way around."""
    return np.clip(WIDE * softened(skin, cap), 0, 1).astype(np.float32)


def edge(skin: Floats, feet: Floats, cap: Floats) -> Floats:
    """Density [n] of fine hairs on skin [n, 3] mm: across the edge of the hair that lies over it
    [f, 3] mm, where a head of hair ends by its cap [n] 0..1."""
    apart = np.asarray(KDTree(feet).query(skin, k=BULK)[0])[:, -1]
    bare = apart > BARE_MM
    within = np.asarray(KDTree(skin[bare]).query(skin)[0])
    x, y, z = skin.T
    wave = np.sin(0.55 * x + np.sin(0.4 * y)) * np.sin(0.6 * y + np.sin(0.5 * z)) + np.sin(0.8 * z)
    off = np.where(bare, apart - BARE_MM, -within) + UNEVEN_MM * wave
    density = np.interp(off, INSIDE_MM + BEFORE_MM, (0, 1, 1, 0)) ** 2
    return growing(skin, cap) * density
