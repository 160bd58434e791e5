"""The collar of a shirt: a folded band around its neckline, as a T-shirt has it, on a curve that is
smooth where the mesh is not; and cloth that hangs on where the mesh of the bust ends."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.spatial import KDTree

from render.clothes import height
from render.decoder import beard as beards
from render.decoder import mesh_parts
from render.decoder.beard import Beard
from render.lighting import STUDIO
from render.strands import strand_light
from render.training.geometry.assembly import Assembly
from render.types import Floats

Array = NDArray[np.floating]

# Rows of the band from its seam up and over its fold: heights over the neckline, off the skin;
# which way each faces, from outward; how bright. How wide a row is; a piece, how far apart.
RISE_MM, OUT_MM = (
    (-9.0, -7.6, -6.1, -4.6, -3.1, -1.6, -0.3, 0.5),
    (1.3, 2.0, 2.3, 2.4, 2.4, 2.3, 1.8, 0.9),
)
FACING_DEG = (-25, -10, 0, 5, 10, 20, 45, 75)
BRIGHT = (0.62, 0.95, 1.0, 1.0, 1.0, 1.0, 1.0, 0.85)
ROW_MM, PIECE_MM, APART_MM = 0.85, 8.5, 3.0
EVEN_MM = 9.0  # standard deviation over which the curve is evened
MATTE = 0.6  # of the lamps that cloth sees: strands mirror as hair does, cloth does not
# Below the bust: how far down, rows of that, how wide; a piece, how far apart, how far inside.
HANG_MM, HANGS, HANG_ROW_MM = 64.0, 17, 2.0
HANG_PIECE_MM, HANG_APART_MM, INSIDE_MM = 14.0, 8.0, 3.0
FADE_MM = (-192.0, -168.0)  # as the bust fades


class Curve(NamedTuple):
    """Places along an edge, [n]."""

    points: Array  # [n, 3] mm
    corners: NDArray[np.integer]  # [n, 3] the triangle each stands on
    normal: Array  # [n, 3]
    along: Array  # [n, 3]


def collar(
    assembly: Assembly,
    vertices: Floats,  # [V, 3] mm at rest
    used: NDArray[np.integer],  # [U] vertices whose light is known
    seen: Floats,  # [4, U] shares of light
    color: tuple[float, float, float],
) -> Beard:
    """For one person; it moves with the skin as a beard does."""
    curve = neckline(assembly, vertices, used)
    up = np.cross(curve.normal, curve.along)
    up *= np.sign(up[:, 1:2])
    parts = []
    for rise, off, facing, bright in zip(
        RISE_MM, OUT_MM, np.radians(FACING_DEG), BRIGHT, strict=True
    ):
        normal = np.cos(facing) * curve.normal + np.sin(facing) * up
        middle = curve.points + rise * up + off * curve.normal
        row = curve._replace(points=middle, normal=normal)
        half = 0.5 * PIECE_MM * curve.along
        lines = np.stack([middle - half, middle + half], 1)
        parts.append(cloth(lines, row, ROW_MM, vertices, used, seen, color, bright))
    return beards.joined(parts)


def drape(
    assembly: Assembly,
    vertices: Floats,
    used: NDArray[np.integer],
    seen: Floats,
    color: tuple[float, float, float],
) -> Beard:
    """Cloth that goes on below the lower edge of the bust, behind and beside."""
    faces = assembly.face.faces[assembly.kinds == mesh_parts.SKIN]
    sides = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    _, first, count = np.unique(np.sort(sides, 1), axis=0, return_index=True, return_counts=True)
    ends = first[count == 1]
    low = assembly.face.neutral[sides[ends], 1].mean(1) < FADE_MM[1] / 2
    ends = ends[low]
    curve = even(
        vertices[sides[ends, 0]],
        vertices[sides[ends, 1]],
        faces[ends % len(faces)],
        vertices,
        HANG_APART_MM,
    )
    below = np.cross(curve.along, curve.normal)
    below *= -np.sign(below[:, 1:2])
    step, parts = HANG_MM / HANGS, []
    at, half = curve.points - INSIDE_MM * (below + curve.normal), 0.5 * HANG_PIECE_MM * curve.along
    for row in range(HANGS):
        turn = min(3 * row / HANGS, 1)
        way = (1 - turn) * below + turn * np.array([0, -1, 0])
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        normal = np.cross(way, curve.along)
        normal *= np.sign((normal * curve.normal).sum(1, keepdims=True))
        shown = np.clip((at[:, 1] - FADE_MM[0]) / (FADE_MM[1] - FADE_MM[0]), 0, 1)
        rows = np.flatnonzero(shown > 0)
        lines = np.stack([at - half, at + half], 1)[rows]
        some = Curve(at[rows], curve.corners[rows], normal[rows], curve.along[rows])
        made = cloth(lines, some, HANG_ROW_MM, vertices, used, seen, color, 1.0)
        made.opacities[:] *= shown[rows]
        parts.append(made)
        at = at + step * way
    return beards.joined(parts)


def neckline(assembly: Assembly, vertices: Floats, used: NDArray[np.integer]) -> Curve:
    """Where the shirt ends."""
    neutral, faces = assembly.face.neutral, assembly.face.faces[assembly.kinds == mesh_parts.SKIN]
    above = height(neutral)[faces] > 0
    crossed = (above.sum(1) % 3 > 0) & np.isin(faces, used).all(1)
    faces, above = faces[crossed], above[crossed]
    alone = (above == (above.sum(1) == 1)[:, None]).argmax(1)  # on the other side than two are
    corners = np.take_along_axis(faces, (alone[:, None] + np.arange(3)) % 3, 1)
    a, b, c = height(neutral)[corners].T
    one, other, none = a / (a - b), a / (a - c), np.zeros_like(a)
    first, last = np.stack([1 - one, one, none], 1), np.stack([1 - other, none, other], 1)
    ends = [(vertices[corners] * share[..., None]).sum(1) for share in (first, last)]
    return even(ends[0], ends[1], corners, vertices, APART_MM)


def even(
    starts: Array,  # [m, 3] mm: pieces of a closed edge, and ...
    ends: Array,
    corners: NDArray[np.integer],  # [m, 3] ... their triangles
    vertices: Floats,
    apart: float,  # mm
) -> Curve:
    """Evenly spaced places along it, without the corners of the mesh."""
    middle = 0.5 * (starts + ends)
    order = np.argsort(np.arctan2(middle[:, 0], middle[:, 2] - middle[:, 2].mean()))
    middle, corners = middle[order], corners[order]
    step = np.linalg.norm(np.roll(middle, -1, 0) - middle, axis=1)
    until = np.concatenate([[0], np.cumsum(step)])
    at = np.linspace(0, until[-1], round(until[-1] / apart), endpoint=False)
    closed = np.concatenate([middle, middle[:1]])
    normals = beards.frames(vertices, corners)[..., 2]
    outward = np.concatenate([normals, normals[:1]])
    sigma = EVEN_MM / apart

    def smooth(values: Array) -> Array:
        rows = np.stack([np.interp(at, until, v) for v in values.T], 1)
        return gaussian_filter1d(rows, sigma, axis=0, mode="wrap")

    points, normal = smooth(closed), smooth(outward)
    along = np.roll(points, -1, 0) - np.roll(points, 1, 0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    normal -= (normal * along).sum(1, keepdims=True) * along
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    near = np.asarray(KDTree(vertices[corners].mean(1)).query(points)[1])
    return Curve(points, corners[near], normal, along)


def cloth(
    lines: Array,  # [n, 2, 3] mm
    curve: Curve,
    wide_mm: float,
    vertices: Floats,
    used: NDArray[np.integer],
    seen: Floats,  # [4, U]
    color: tuple[float, float, float],
    bright: float,
) -> Beard:
    """Pieces as bright as cloth is, not as hair."""
    row = np.full(len(vertices), -1)
    row[used] = np.arange(len(used))
    known = seen[:, row[curve.corners]].mean(2).T
    normal, along = curve.normal.astype(np.float32), lines[:, 1] - lines[:, 0]
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    wanted = (
        bright * np.array(color, np.float32) ** 2 * STUDIO.shade(normal, known.astype(np.float32))
    )
    known[:, 1:] *= MATTE
    # strands are lit as they are drawn: facing the way of their triangle's normal
    outward = beards.frames(vertices, curve.corners)[..., 2]
    albedo = wanted
    for _ in range(3):
        lit = strand_light(along, outward, albedo, known, STUDIO)
        albedo = np.clip(albedo * wanted / np.maximum(lit, 1e-4), 0, 1)
    widths, opacities = (np.full((len(lines), 1), v, np.float32) for v in (wide_mm, 0.97))
    albedo, known = albedo.astype(np.float32), known.astype(np.float32)
    return beards.attached(
        lines.astype(np.float32), widths, curve.corners, vertices, opacities, albedo, known
    )
