"""Strands traced over textured hair cards: a smooth field of directions, clumps and volume."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from render.avatars.textures import sample
from render.strands import away
from render.types import Floats

SEEDS, SAMPLES = 14_000, 36_000  # strands; places on the cards that the field is read from
STEP_MM, STEPS = 2.6, 56  # along a strand
SMOOTH_MM, SMOOTHED = 5.0, 16  # smoothing of the field, and how often
MIDDLE_MM = 34.0  # half of the width behind the head over which strands turn straight down
REACH_MM = 5.5  # a strand ends this far off the cards
CROWN_MM, FALL = np.array([0.0, 140.0, -25.0]), 0.6  # hair flows away from it; and down
VOLUME_MM, FRIZZ = 2.2, 0.25  # mm between layers; stray of a strand
CLUMP = 26  # strands of a tuft, which stray together
CROWN, FEW, WIDE, PEAK_MM = 0.8, 2500, 150, 2.5  # least height of `away`; pieces; around; above
LEAST = 3  # ends of pieces of a strand that counts
AROUND, ASTRAY = 24, 0.85  # pieces; less of the cosine to the way they go is a spike, not hair


@dataclass(frozen=True)
class Pieces:
    """[n] short pieces of strands."""

    middles: Floats  # [n, 3] mm
    along: Floats  # [n, 3] unit
    bright: Floats  # [n] of the card there, 1 in the middle of all
    progress: Floats  # [n] 0 at the root, 1 at the tip
    strand: NDArray[np.intp]  # [n] which of them

    def of(self, rows: NDArray[np.intp]) -> "Pieces":
        """Some of them."""
        return Pieces(*(part[rows] for part in vars(self).values()))


def trace(
    corners: Floats,  # [T, 3, 3] mm
    uv: Floats,  # [T, 3, 2]
    texture: Floats,  # [H, W, 4]
    directions: Floats,  # [T, 3] of the strands on each card
    span: int,  # steps of a piece
    rng: np.random.Generator,
) -> Pieces:
    """All of every strand."""
    points, along, alpha, light = _field(corners, uv, texture, directions, rng)
    tree, outward = KDTree(points), away(points.astype(np.float32)).astype(np.float64)
    good = np.flatnonzero(alpha > 0.35)
    first = rng.choice(good, SEEDS)
    start = points[first] + rng.normal(0, 0.6, (SEEDS, 3))
    lift = (0.6 * rng.normal(0, VOLUME_MM, SEEDS) - 0.2 * VOLUME_MM)[:, None]
    tufts = KDTree(points[rng.choice(good, SEEDS // CLUMP)]).query(start)[1]
    stray = rng.normal(0, 1, (SEEDS, 3))[tufts]
    lines = np.full((SEEDS, STEPS, 3), np.nan)
    half = STEPS // 2
    for sign, steps in ((1, range(half, STEPS)), (-1, range(half, -1, -1))):
        at, alive, last = start.copy(), np.ones(SEEDS, bool), None
        for step in steps:
            distance, near = (np.asarray(x) for x in tree.query(at, k=5))
            weight = np.exp(-((distance / 4) ** 2)) + 1e-9
            weight = (weight / weight.sum(1, keepdims=True))[..., None]
            alive &= (distance[:, 0] < REACH_MM) & ((alpha[near] * weight[..., 0]).sum(1) > 0.10)
            way = (along[near] * weight).sum(1)
            if last is None:
                way = way * sign
            else:
                turned = np.where((way * last).sum(1) < 0, -1.0, 1.0)[:, None]
                way = 0.6 * way * turned + 0.4 * last
            way += FRIZZ * (0.10 * stray + 0.06 * rng.normal(0, 1, at.shape))
            way /= np.linalg.norm(way, axis=1, keepdims=True) + 1e-9
            last = way
            out, middle = (outward[near] * weight).sum(1), (points[near] * weight).sum(1)
            if sign > 0 or step < half:
                lines[:, step] = np.where(alive[:, None], at + lift * out, np.nan)
            off = ((at - middle) * out).sum(1, keepdims=True)
            at = at - 0.35 * off * out + STEP_MM * way
    return _pieces(lines[:, ::span], (light / np.median(light[alpha > 0.5]))[first])


def evened(pieces: Pieces) -> Pieces:
    """Without the peak where cards meet on the crown: lowered to what lies around."""
    out, some = away(pieces.middles), pieces.middles[:: max(len(pieces.middles) // FEW, 1)]
    high = np.flatnonzero(out[:, 1] > CROWN)
    around = some[np.asarray(KDTree(some).query(pieces.middles[high], k=min(WIDE, len(some)))[1])]
    above = ((pieces.middles[high] - around.mean(1)) * out[high]).sum(1)
    usual = np.median(above)
    middles = pieces.middles.copy()
    middles[high] -= np.maximum(above - usual - PEAK_MM, 0)[:, None] * out[high]
    return replace(pieces, middles=middles)


def in_line(middles: Floats, along: Floats) -> NDArray[np.bool_]:  # [n, 3] mm, [n, 3] -> [n]
    """Those that go the way of the hair around them."""
    near = np.asarray(KDTree(middles).query(middles, k=min(AROUND, len(middles)))[1])
    spread = np.einsum("nki,nkj->nij", along[near], along[near])
    way = np.linalg.eigh(spread)[1][..., -1]
    return np.abs((way * along).sum(1)) > ASTRAY


def strewn(
    corners: Floats, count: int, rng: np.random.Generator
) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Even places on triangles [T, 3, 3]: which of them [n], shares of the corners [n, 3, 1]."""
    edges = corners[:, 1:] - corners[:, :1]
    area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    chosen = rng.choice(len(area), count, p=area / area.sum())
    u, v = rng.random((2, count))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    return chosen, np.stack([1 - u - v, u, v], 1)[..., None]


def _field(corners, uv, texture, directions, rng):  # type: ignore[no-untyped-def]
    """Places on the cards, and which way strands go there: smooth, away from the crown."""
    chosen, weights = strewn(corners, SAMPLES, rng)
    points = (corners[chosen] * weights).sum(1).astype(np.float64)
    rgba = sample(texture, (uv[chosen] * weights).sum(1).astype(np.float32))
    along = directions[chosen].astype(np.float64)
    flow = points - CROWN_MM
    flow /= np.linalg.norm(flow, axis=1, keepdims=True) + 1e-9
    flow[:, 1] -= FALL
    along *= np.where((along * flow).sum(1) < 0, -1.0, 1.0)[:, None]
    outward = away(points.astype(np.float32))
    distance, near = (np.asarray(x) for x in KDTree(points).query(points, k=14))
    weight = np.exp(-((distance / SMOOTH_MM) ** 2)) * np.clip(rgba[near, 3], 0.05, 1)
    weight *= np.clip((outward[near] * outward[:, None]).sum(2), 0, 1)
    parts = np.clip(4 * outward[:, 1:2] - 2, 0, 1)  # on top hair parts, elsewhere it goes on
    behind = np.clip(-4 * outward[:, 2], 0, 1) * (1 - parts[:, 0])
    across = 1 - behind * np.exp(-((points[:, 0] / MIDDLE_MM) ** 2))  # no seam where sides meet
    for _ in range(SMOOTHED):
        alike = (along[near] * along[:, None]).sum(2)
        alike = np.sign(alike) * (1 - parts) + np.clip(alike, 0, 1) * parts
        along = (along[near] * (weight * alike)[..., None]).sum(1)
        along /= np.linalg.norm(along, axis=1, keepdims=True) + 1e-9
    along[:, 0] *= across
    along /= np.linalg.norm(along, axis=1, keepdims=True) + 1e-9
    return points, along, rgba[:, 3], rgba[:, :3] @ np.array([0.3, 0.59, 0.11])


def _pieces(lines: Floats, bright: Floats) -> Pieces:
    alive = np.isfinite(lines[..., 0])
    count, first = alive.sum(1), alive.argmax(1)
    both = alive[:, 1:] & alive[:, :-1] & (count >= LEAST)[:, None]
    strand, step = np.nonzero(both)
    a, b = lines[strand, step], lines[strand, step + 1]
    along = (b - a) / (np.linalg.norm(b - a, axis=1, keepdims=True) + 1e-9)
    progress = (step - first[strand] + 0.5) / np.maximum(count[strand] - 1, 1)
    parts = (0.5 * (a + b), along, np.clip(bright[strand], 0.4, 2), np.clip(progress, 0, 1))
    middles, along, bright, progress = (np.asarray(p, np.float32) for p in parts)
    return Pieces(middles, along, bright, progress, strand)


def strand_quats(along: Floats, normals: Floats) -> Floats:  # [n, 3], [n, 3] -> [n, 4] wxyz
    """Rotations whose x axis is the strand and whose z axis is nearest to the normal."""
    from scipy.spatial.transform import Rotation

    across = np.cross(normals, along)
    length = np.linalg.norm(across, axis=1, keepdims=True)
    across = np.where(length > 1e-3, across / (length + 1e-9), np.cross(along, (0.3, 0.9, 0.2)))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    matrix = np.stack([along, across, np.cross(along, across)], -1)
    return Rotation.from_matrix(matrix).as_quat(scalar_first=True)
