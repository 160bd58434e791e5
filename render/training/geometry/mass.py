"""The mass of a head of hair: wide dark Gaussians below its strands, so that no skin and no
background shows between them. As the layer below the skin (`render/decoder/density.py`).
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from render.strands import THIN_MM, Hair, away, joined
from render.training.geometry.trace import Pieces, strand_quats
from render.types import Floats

COUNT = 5000
SOME, NEAR = 20_000, 48  # pieces that tell where the hair is; around a place
DEPTH_MM, THICK_MM = 1.8, 0.5  # below the strands; standard deviation
ACROSS, ALONG = 0.68, 0.85  # standard deviations, as a share of the distance to the neighbours
REACH, LIMITS = 1.3, (0.8, 1.6)  # least distance, in how far it is alone; in the usual one
MOVES = 8  # of each to the middle of what it is nearest to
DARK, LIGHT, OPACITY = 0.5, 0.75, 0.97  # brightness, as a share of the strands', and more if light
EDGE = 0.20, 0.42  # how far the middle of them is off, in their radius: inside the hair, at its end
WHOLE, LIT = 25, 75  # percentiles around a place: of `whole`, as strands go on; of the light
MATTE, CLEAR = 0.32, 1.1  # of the lamps that it sees, and more if light: what glints is strands
# See `hidden`: opacity; how many; light through them; how far inside; how far off they are.
SOLID, AROUND, GAPS, INSIDE_MM, BENEATH_MM, HIGH_MM = 0.88, 8, 0.25, 9.0, -4.0, 19.0
# Of the lining: what lies further back is not seen from inside; least distance of the mass from the
# skin, how far behind it; one for so many of it; share of its stored colour and of its light.
BACK_MM, LINED_MM, BEHIND_MM, FEWER, INSIDE = -30.0, 9.0, np.float32(4.0), 2, np.float32(0.6)
FEWEST = 0.05  # opacity below which one is left out


def sheet(middles: Floats, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Where the hair's surface is near each piece [n, 3] mm; 0 at its edges, from which all hair
    lies to one side, .. 1 [n]."""
    some = middles[rng.permutation(len(middles))[:SOME]]
    distance, near = (np.asarray(x) for x in KDTree(some).query(middles, k=NEAR))
    places = some[near].mean(1)
    off, out = places - middles, upright(some, near)
    off -= (off * out).sum(1, keepdims=True) * out
    one_sided = np.linalg.norm(off, axis=1) / (distance[:, -1] + 1e-6)
    whole = np.clip((EDGE[1] - one_sided) / (EDGE[1] - EDGE[0]), 0, 1)
    return places, (whole * whole * (3 - 2 * whole)).astype(np.float32)


def upright(points: Floats, near: NDArray[np.intp]) -> Floats:  # [n, 3] mm, [m, k] -> [m, 3]
    """Normals of the surface through some of the points, out of the head."""
    spread = np.zeros((len(near), 3, 3), np.float32)
    middle = points[near].mean(1)
    for row in near.T:
        off = points[row] - middle
        spread += off[:, :, None] * off[:, None]
    out = np.linalg.eigh(spread)[1][..., 0]
    return out * np.where((out * away(middle)).sum(1) < 0, -1, 1)[:, None]


def mass(
    pieces: Pieces,
    places: Floats,  # [n, 3] mm of the hair's surface there
    whole: Floats,  # [n] 0 at the edges of the hair .. 1
    seen: Floats,  # [n, 4] shares of light
    linear: Floats,  # [3] colour of the hair
    rng: np.random.Generator,
) -> tuple[Hair, float]:
    """It, and how large its surface is, mm^2."""
    middles, reach = spread(places, COUNT, rng)
    some = rng.permutation(len(places))[:SOME]
    near = some[KDTree(places[some]).query(middles, k=NEAR)[1]]
    along, out, upward = pieces.along[near].mean(1), away(middles), upright(places, near)
    # behind, a glint that follows the surface would be a band across all the mass
    across = np.where(middles[:, 2:] > BACK_MM, upward, out)
    along -= (along * across).sum(1, keepdims=True) * across
    along /= np.linalg.norm(along, axis=1, keepdims=True) + 1e-9
    shown = OPACITY * np.percentile(whole[near[:, : NEAR // 3]], WHOLE, axis=1)
    apart = np.asarray(KDTree(middles).query(middles, k=6)[0])[:, 1:].mean(1)
    apart = np.maximum(apart, REACH * reach)
    apart = apart.clip(*(np.array(LIMITS) * np.median(apart)))[:, None]
    stays = np.flatnonzero(shown > FEWEST)
    color = np.sqrt(linear * (DARK + LIGHT * np.sqrt(linear.mean())))
    matte = min(MATTE + CLEAR * np.sqrt(linear.mean()), 1)
    deep = DEPTH_MM * (upward * out).sum(1, keepdims=True) * upward  # none beside a tail
    light = np.percentile(seen[near], LIT, axis=1) * (1, matte, matte, matte)
    size = np.concatenate([ALONG * apart, ACROSS * apart, np.full_like(apart, THICK_MM)], 1)
    made = Hair(
        (middles - deep)[stays].astype(np.float32),
        strand_quats(along[stays], upward[stays]).astype(np.float32),
        size[stays].astype(np.float32),
        shown[stays].astype(np.float32),
        np.tile(color, (len(stays), 1)).clip(0, 1).astype(np.float32),
        light[stays].astype(np.float32),
    )
    return made, float((apart**2).sum())


def lined(hair: Hair, skin: Floats) -> Hair:
    """As many Gaussians, with an inside where hair is swept off the skin [n, 3] mm at the temples:
    deep in its own shadow, where the mass is lit as it is outside."""
    body = hair.rows(np.flatnonzero(_solid(hair) & (hair.means[:, 2] > BACK_MM)))
    if len(body) == 0:
        return hair
    hangs = np.flatnonzero(np.asarray(KDTree(skin).query(body.means)[0]) > LINED_MM)
    rows = hangs[evenly(body.means[hangs], len(hangs) // FEWER, np.random.default_rng(0))]
    inside, wider = body.rows(rows), np.array([FEWER**0.5, FEWER**0.5, 1], np.float32)
    inside = replace(
        inside,
        means=inside.means - BEHIND_MM * away(inside.means),
        scales=wider * inside.scales,
        albedo=INSIDE * inside.albedo,
        seen=INSIDE * inside.seen,
    )
    return joined([inside, hair.rows(slice(len(hair) - len(inside)))])


def hidden(points: Floats, hair: Hair) -> NDArray[np.bool_]:  # [n, 3] mm -> [n]
    """What lies below the whole of a mass, from whichever side one looks."""
    body = np.flatnonzero(_solid(hair))
    if len(body) < AROUND:
        return np.zeros(len(points), bool)
    means, out = hair.means[body], away(points)[:, None]
    distance, near = (np.asarray(x) for x in KDTree(means).query(points, k=AROUND))
    off = means[near] - points[:, None]
    above = (off * out).sum(2)
    aside = ((off - above[..., None] * out) ** 2).sum(2)
    clear = 1 - np.exp(-0.5 * aside / hair.scales[body, 1][near] ** 2)
    thick = (clear.prod(1) < GAPS) & (above.mean(1) > BENEATH_MM) & (distance[:, -1] < HIGH_MM)
    return thick & (np.asarray(KDTree(points[~thick]).query(points)[0]) > INSIDE_MM)


def _solid(hair: Hair) -> NDArray[np.bool_]:  # [h]
    """What of it is a mass that nothing is seen through."""
    return (hair.scales[:, 1] > THIN_MM) & (hair.opacities > SOLID)


def evenly(points: Floats, count: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """About `count` of the points, at most: one in each cell of a grid."""
    low, high = 0.2, 20.0
    order = rng.permutation(len(points))
    rows = order
    for _ in range(9):
        size = 0.5 * (low + high)
        rows = order[np.unique(cells(points[order], size), return_index=True)[1]]
        low, high = (size, high) if len(rows) > count else (low, size)
    return rng.permutation(rows)[:count]


def spread(
    points: Floats, count: int, rng: np.random.Generator
) -> tuple[Floats, Floats]:  # [n, 3] mm -> [c, 3] mm, [c] mm
    """About `count` places as far from each other as can be, and how far the points reach that
    none is nearer to."""
    middles = points[evenly(points, count, rng)]
    points = points[evenly(points, SOME, rng)]
    for _ in range(MOVES):
        nearest = np.asarray(KDTree(middles).query(points)[1])
        own = np.bincount(nearest, minlength=len(middles))
        sums = [np.bincount(nearest, axis, len(middles)) for axis in points.T]
        middles = np.where(own[:, None] > 0, np.stack(sums, 1) / own.clip(1)[:, None], middles)
    distance, nearest = (np.asarray(x) for x in KDTree(middles).query(points))
    reach = np.zeros(len(middles))
    np.maximum.at(reach, nearest, distance)
    return middles.astype(np.float32), reach.astype(np.float32)


def cells(points: NDArray[np.floating], size: float) -> NDArray[np.int64]:  # [n, 3] mm -> [n]
    """Which cell of a grid each point lies in."""
    x, y, z = np.floor(points / size).astype(np.int64).T
    return (x * 4096 + y) * 4096 + z
