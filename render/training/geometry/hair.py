"""Hair as long thin Gaussians along the strands of textured hair cards (MakeHuman, CC0).

Strands are traced along the cards: every Gaussian lies in the card's plane but is lit as part of
the whole head of hair, with the light that reaches it, so a card seen edge-on does not show.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from render.avatars.textures import sample
from render.gl.occlusion import Occlusion
from render.strands import Hair, away
from render.training.data.face_data import MM_PER_UNIT, SKIN_VERTICES
from render.training.geometry.assembly import Assembly
from render.training.geometry.trace import CROWN_MM, Pieces, trace
from render.types import Floats

Tint = tuple[float, float, float]
CANDIDATES = 2  # pieces a Gaussian kept
STRAND_MM, CURL_MM = (4.4, 0.50, 0.30), (1.5, 0.50, 0.50)  # standard deviations
CURLS, CURLS_COUNT = ("afro01",), 40_000
APART_MM = 2.4  # of neighbours, where hair is as thin as STRAND_MM says
HIDDEN = 0.14  # share of any light below which a piece is left out
CROP_MM, CROP_SEEN = (0.9, 0.10, 0.10), (0.75, 0.7, 0.7, 0.7)  # of hair cut to a few millimetres
OPACITY, SPREAD, GAIN = 0.85, 0.08, 1.05
ROOT = 0.75  # brightness there
DIMMEST, CLEAR = 0.20, 0.55  # share of light that always gets through; and more in light hair
FRINGE, FAINT, NEAR_MM = 0.35, 0.5, 7.0  # width and opacity at the hairline, so near the skin
DARK = 0.02  # share of the sky inside a mouth
LIFT_MM = 0.8  # hair stays this far outside the skin


@dataclass(frozen=True)
class Cards:
    """One style on one head."""

    corners: Floats  # [T, 3, 3] mm
    uv: Floats  # [T, 3, 2]
    texture: Floats | None  # [H, W, 4]; none for curls
    cap: Floats  # [SKIN_VERTICES] 0..1 hair cover of the skin


def cards(assembly: Assembly, vertices: Floats, normals: Floats, style: str) -> Cards:
    """Bind a style to a person at rest."""
    face = assembly.face
    z = np.load(face.folder / "hair" / f"hair_{style}.npz", allow_pickle=False)
    bound = vertices[z["bind_idx"]] / MM_PER_UNIT
    points = ((bound * z["bind_w"][..., None]).sum(1) + z["offsets"]) * MM_PER_UNIT
    points = push_out(points.astype(np.float32), vertices, normals)
    texture = None
    if style not in CURLS:
        texture = face.image(f"hair/{style.removesuffix('_swept')}.png")
    return Cards(points[z["tris"]], z["uv"][z["tris"]], texture, z["scalp_cap"].astype(np.float32))


def push_out(points: Floats, vertices: Floats, normals: Floats) -> Floats:
    """Move hair that fell inside the skin outside it."""
    skin, out = vertices[:SKIN_VERTICES], points.copy()
    for _ in range(2):
        _, near = KDTree(skin).query(out, k=4)
        normal = normals[near].mean(1)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True) + 1e-9
        height = ((out[:, None] - skin[near]) * normals[near]).sum(2).mean(1)
        inside = (height < LIFT_MM) & (height > -25)
        out[inside] += (LIFT_MM - height[inside])[:, None] * normal[inside]
    return out


def grow(
    worn: Cards, tint: Tint, count: int, occlusion: Occlusion, vertices: Floats, seed: int
) -> Hair:
    """At most `count` Gaussians, of the pieces of strands that see some light."""
    rng = np.random.default_rng(seed)
    if worn.texture is None:
        pieces, size = _curls(worn, rng), CURL_MM
        cover = worn.corners
    else:
        directions = strands(worn.corners, worn.uv)
        pieces, size = trace(worn.corners, worn.uv, worn.texture, directions, rng), STRAND_MM
        cover = opaque(worn)
    some = evenly(pieces.middles, CANDIDATES * count, rng)
    middles, outward = pieces.middles[some], away(pieces.middles[some])
    seen = occlusion(vertices, outward, cover, (middles, outward), offset_mm=4.0)
    lit = np.flatnonzero(seen.max(1) > HIDDEN)
    chosen = lit[evenly(middles[lit], count, rng)]
    dimmest = DIMMEST + CLEAR * float(np.mean(tint)) ** 2
    rows, seen = some[chosen], np.maximum(smoothed(middles[chosen], seen[chosen]), dimmest)
    bright = pieces.bright[rows] ** 0.9 * rng.lognormal(0, SPREAD, len(rows))
    tone = rng.normal(1, (0, 0.03, 0.05), (len(rows), 3)) * bright[:, None]
    dark = ROOT + (1 - ROOT) * np.clip(3 * pieces.progress[rows], 0, 1)
    linear = GAIN * np.array(tint) ** 2 * tone * dark[:, None]
    scales = np.tile(np.array(size, np.float32), (len(rows), 1))
    scales *= np.clip(1 + 0.15 * rng.standard_normal((len(rows), 1)), 0.6, 1.5)
    apart = KDTree(middles[chosen]).query(middles[chosen], k=7)[0][:, 1:].mean(1)
    scales[:, 1] *= np.clip(apart / APART_MM, 0.8, 1.8)
    tip = np.clip((1 - pieces.progress[rows]) / 0.15, 0.35, 1)
    scales[:, 1] *= tip
    fine = fringe(worn, middles[chosen], vertices)
    scales[:, 1] *= FRINGE + (1 - FRINGE) * fine
    return Hair(
        pieces.middles[rows],
        strand_quats(pieces.along[rows], outward[chosen]).astype(np.float32),
        scales.astype(np.float32),
        (OPACITY * (FAINT + (1 - FAINT) * fine)).astype(np.float32),
        np.sqrt(np.clip(linear, 0, 1)).astype(np.float32),
        seen,
    )


def cropped(
    assembly: Assembly, vertices: Floats, cap: Floats, tint: Tint, count: int, seed: int
) -> Hair:
    """A few millimetres of hair all over the cap [SKIN_VERTICES], thin where the cap ends."""
    rng = np.random.default_rng((seed, 3))
    skin = assembly.face.faces[(assembly.face.faces < SKIN_VERTICES).all(1)]
    corners, cover = vertices[skin], np.clip(cap, 0, 1)[skin].mean(1)
    edges = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(edges, axis=1) * np.clip((cover - 0.15) / 0.6, 0, 1) ** 1.5
    chosen = rng.choice(len(skin), count, p=areas / areas.sum())
    weights = rng.dirichlet((1, 1, 1), count).astype(np.float32)
    roots = (corners[chosen] * weights[..., None]).sum(1)
    outward = edges[chosen] / np.linalg.norm(edges[chosen], axis=1, keepdims=True)
    flow = roots - CROWN_MM
    flow -= (flow * outward).sum(1, keepdims=True) * outward
    flow /= np.linalg.norm(flow, axis=1, keepdims=True) + 1e-9
    along = 0.6 * outward + flow + rng.normal(0, 0.25, roots.shape)
    along = (along / np.linalg.norm(along, axis=1, keepdims=True)).astype(np.float32)
    length = CROP_MM[0]
    size = np.tile(np.array(CROP_MM, np.float32), (count, 1))
    linear = np.array(tint) ** 2 * rng.lognormal(0, 0.2, (count, 1))
    return Hair(
        (roots + 1.2 * length * along).astype(np.float32),
        strand_quats(along, outward).astype(np.float32),
        size,
        np.full(count, OPACITY, np.float32),
        np.sqrt(np.clip(linear, 0, 1)).astype(np.float32),
        np.tile(np.array(CROP_SEEN, np.float32), (count, 1)),
    )


def evenly(points: Floats, count: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """About `count` of the points, at most: one in each cell of a grid."""
    low, high = 0.2, 8.0
    order = rng.permutation(len(points))
    rows = order
    for _ in range(9):
        size = 0.5 * (low + high)
        cells = np.floor(points[order] / size).astype(np.int64)
        key = (cells[:, 0] * 4096 + cells[:, 1]) * 4096 + cells[:, 2]
        rows = order[np.unique(key, return_index=True)[1]]
        low, high = (size, high) if len(rows) > count else (low, size)
    return rng.permutation(rows)[:count]


def smoothed(points: Floats, seen: Floats) -> Floats:
    """Light that reaches hair goes on through it: no hard shadows of single cards."""
    near = np.asarray(KDTree(points).query(points, k=min(12, len(points)))[1])
    return seen[near].mean(1).astype(np.float32)


def fringe(worn: Cards, points: Floats, vertices: Floats) -> Floats:  # [n]
    """0 at the hairline, where hair is fine, so that it has no edge; else 1."""
    distance, near = (np.asarray(x) for x in KDTree(vertices[:SKIN_VERTICES]).query(points))
    covered = np.clip((np.clip(worn.cap, 0, 1)[near] - 0.1) / 0.7, 0, 1)
    away = np.clip(distance / NEAR_MM - 1, 0, 1)
    return np.maximum(covered, away).astype(np.float32)


def under(with_hair: Floats, bald: Floats) -> Floats:  # [U] shares of the sky -> [U] 0..1
    """Which skin hair lies over, by the light that it takes."""
    share = np.clip((0.5 - with_hair / np.maximum(bald, DARK)) / 0.4, 0, 1)
    return (share * (bald > DARK)).astype(np.float32)


def _curls(worn: Cards, rng: np.random.Generator) -> Pieces:
    """Short arcs of tight curls, in tufts, under the hull of a style."""
    edges = worn.corners[:, 1:] - worn.corners[:, :1]
    area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    chosen = rng.choice(len(area), CURLS_COUNT, p=area / area.sum())
    u, v = rng.random((2, CURLS_COUNT))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    hull = (worn.corners[chosen] * np.stack([1 - u - v, u, v], 1)[..., None]).sum(1)
    outward = away(hull.astype(np.float32))
    depth = rng.uniform(-2.5, 6, (CURLS_COUNT, 1)) * rng.uniform(0.3, 1, (CURLS_COUNT, 1))
    middles = (hull - outward * depth).astype(np.float32)
    tufts = KDTree(middles[: CURLS_COUNT // 14]).query(middles)[1]
    axis = rng.standard_normal((CURLS_COUNT, 3))[tufts] + 0.5 * outward
    along = np.cross(axis, rng.standard_normal((CURLS_COUNT, 3)))
    along /= np.linalg.norm(along, axis=1, keepdims=True) + 1e-9
    shade = np.clip(1.05 - 0.09 * depth[:, 0], 0.4, 1.3)
    shade = shade.astype(np.float32)
    return Pieces(middles, along.astype(np.float32), shade, np.full_like(shade, 0.5))


def opaque(worn: Cards) -> Floats:
    """Triangles that are more hair than air: they cast shadow."""
    assert worn.texture is not None
    middle = worn.uv.mean(1).astype(np.float32)
    return worn.corners[sample(worn.texture, middle)[:, 3] > 0.5]


def strands(corners: Floats, uv: Floats) -> Floats:  # [T, 3, 3], [T, 3, 2] -> [T, 3]
    """Direction in which v grows: the textures' strands run along it."""
    e1, e2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    d1, d2 = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    determinant = d1[:, :1] * d2[:, 1:] - d2[:, :1] * d1[:, 1:]
    along = (e2 * d1[:, :1] - e1 * d2[:, :1]) * np.sign(determinant)
    return along / (np.linalg.norm(along, axis=1, keepdims=True) + 1e-9)


def strand_quats(along: Floats, normals: Floats) -> Floats:  # [n, 3], [n, 3] -> [n, 4] wxyz
    """Rotations whose x axis is the strand and whose z axis is nearest to the normal."""
    from scipy.spatial.transform import Rotation

    across = np.cross(normals, along)
    length = np.linalg.norm(across, axis=1, keepdims=True)
    across = np.where(length > 1e-3, across / (length + 1e-9), np.cross(along, (0.3, 0.9, 0.2)))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    matrix = np.stack([along, across, np.cross(along, across)], -1)
    return Rotation.from_matrix(matrix).as_quat(scalar_first=True)
