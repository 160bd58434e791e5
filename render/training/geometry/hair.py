"""Hair as long thin Gaussians along the strands of textured hair cards (MakeHuman, CC0).

Strands are traced along the cards: every Gaussian lies in the card's plane but is lit as part of
the whole head of hair, with the light that reaches it, so a card seen edge-on does not show.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from render.avatars import hairline
from render.decoder.mesh_parts import SKIN_VERTICES
from render.gl.occlusion import Occlusion
from render.strands import Hair, away, axes, joined
from render.training.geometry import rooted
from render.training.geometry.assembly import Assembly
from render.training.geometry.cards import LONG_SPAN, Cards, directions, opaque
from render.training.geometry.curls import curls
from render.training.geometry.mass import SOME, cells, mass, sheet
from render.training.geometry.trace import Pieces, evened, in_line, strand_quats, trace
from render.types import Floats

Tint = tuple[float, float, float]
CURLS_DEEP = (2.5, 0.4)  # mm; light below curls
STRAND_MM, CURL_MM = (1.17, 0.26, 0.20), (0.85, 0.27, 0.27)  # standard deviations, a step long
COVERED, WIDER = 0.14, (0.8, 1.5)  # strands' share of the surface, and how much wider they get
HIDDEN, SHOWN = 0.14, 0.22  # share of any light that the mass sees at least, and that strands do
CROP_SEEN = (0.75, 0.7, 0.7, 0.7)  # of hair cut to a few millimetres
ALONE_MM = 7.0  # from the middle of those around it: a patch by itself is left out
FINE_HAIRS, NEAR = 2200, 16  # along the hairline; strands that tell how they lie
OPACITY, SPREAD, GAIN = 0.85, 0.08, 1.05
LOCKS, LOCK, ACROSS = 320, 0.2, (1, 0.3, 1)  # how many; spread of their light; see `locks`
ROOT = 0.75  # brightness there
DIMMEST, CLEAR = 0.20, 0.55  # share of light that always gets through; and more in light hair
FULLER = 1.5  # a mass of curls is whole so much nearer to its edge
FRINGE, FAINT = 0.5, 0.6  # width and opacity of strands where the hair ends
SHADE_MM, SHADED = (6.0, 18.0), 0.3  # below hair so high fine hairs see all, and less, of its light
RAG_MM, RAG = (8.0, 6.0), 0.25  # off the skin at least; strands so near, as a share of the usual
FREE_MM = 14.0  # off the skin: hair that hangs, seen from both sides
LOWEST_MM = -1.0  # other strands lower than this under the hair's surface would not be seen
DARK = 0.02  # share of the sky inside a mouth


def grow(
    worn: Cards, tint: Tint, count: int, occlusion: Occlusion, vertices: Floats, seed: int
) -> Hair:
    """At most `count` Gaussians, of the pieces of strands that see some light."""
    rng = np.random.default_rng(seed)
    if worn.texture is None:
        pieces, size = curls(worn.corners, rng), CURL_MM
        cover = worn.corners
    else:
        along = directions(worn.corners, worn.uv)
        pieces = evened(trace(worn.corners, worn.uv, worn.texture, along, worn.span, rng))
        size = (worn.span * STRAND_MM[0], *STRAND_MM[1:])
        cover = opaque(worn)
    outward = away(pieces.middles)
    seen = occlusion(vertices, outward, cover, (pieces.middles, outward), offset_mm=4.0)
    best = seen.max(1)
    lit = np.flatnonzero(best > HIDDEN)
    pieces, outward, seen = pieces.of(lit), outward[lit], seen[lit]
    places, whole = sheet(pieces.middles, rng)
    if worn.texture is None:  # springs stand in tufts: between them hair does not end
        whole = np.clip(FULLER * smoothed(pieces.middles, whole[:, None], rng)[:, 0], 0, 1)
    dimmest = DIMMEST + CLEAR * float(np.mean(tint)) ** 2
    seen = np.maximum(smoothed(pieces.middles, seen, rng), np.float32(dimmest))
    below, bright = CURLS_DEEP if worn.texture is None else (0.0, 1.0)
    linear = GAIN * np.array(tint, np.float32) ** 2
    deeper = (places - below * outward).astype(np.float32)
    body, area = mass(pieces, deeper, whole, np.float32(bright) * seen, linear, rng)
    free = np.asarray(KDTree(vertices[:SKIN_VERTICES]).query(pieces.middles)[0]) > FREE_MM
    high = free | (((pieces.middles - places) * outward).sum(1) > LOWEST_MM)
    alone = np.linalg.norm(pieces.middles - places, axis=1) > ALONE_MM
    if worn.texture is not None:
        mean = np.bincount(pieces.strand, best[lit]) / np.maximum(np.bincount(pieces.strand), 1)
        high &= (
            (free | (mean[pieces.strand] > SHOWN)) & ~alone & in_line(pieces.middles, pieces.along)
        )
    high = np.flatnonzero(high)
    rows = high[strands_of(pieces.of(high), count, rng)]
    pieces, outward, seen, whole = pieces.of(rows), outward[rows], seen[rows], whole[rows]
    own = rng.normal(1, (SPREAD, 0.03, 0.05), (pieces.strand.max() + 1, 3))[pieces.strand]
    lock = rng.normal(1, LOCK, LOCKS).clip(1 - 2 * LOCK, 1 + 2 * LOCK)[locks(pieces, rng), None]
    seen = (lock * seen).clip(0, 1).astype(np.float32)
    bright = (pieces.bright**0.9 * own[:, 0])[:, None] * lock**0.5
    own[:, 0] = 1
    dark = ROOT + (1 - ROOT) * np.clip(3 * pieces.progress, 0, 1)
    linear = GAIN * np.array(tint) ** 2 * own * bright * dark[:, None]
    scales = np.tile(np.array(size, np.float32), (len(rows), 1))
    tip = np.clip((1 - pieces.progress) / 0.15, 0.35, 1)
    across = COVERED * area / (len(rows) * scales[:, :2].prod(1))
    scales[:, 1] *= tip * np.clip(across, *WIDER) * (FRINGE + (1 - FRINGE) * whole)
    fibres = Hair(
        pieces.middles,
        strand_quats(pieces.along, outward).astype(np.float32),
        scales.astype(np.float32),
        (OPACITY * (FAINT + (1 - FAINT) * whole)).astype(np.float32),
        np.sqrt(np.clip(linear, 0, 1)).astype(np.float32),
        seen,
    )
    if worn.span == LONG_SPAN:
        body = covered(body, fibres, vertices[:SKIN_VERTICES])
    return joined([body, fibres])


def covered(body: Hair, fibres: Hair, skin: Floats) -> Hair:
    """The mass without rags of it that hang in the air, with hardly a strand near them."""
    hangs = np.asarray(KDTree(skin).query(body.means)[0]) > RAG_MM[0]
    tree = KDTree(fibres.means)
    count = np.asarray(tree.query_ball_point(body.means, RAG_MM[1], return_length=True))
    return body.rows(np.flatnonzero(~hangs | (count > RAG * np.median(count))))


def locks(pieces: Pieces, rng: np.random.Generator) -> NDArray[np.intp]:  # [n] 0 .. LOCKS
    """Which lock each piece goes with: strands whose middles are neighbours, across the hair more
    than along it."""
    long = np.bincount(pieces.strand).clip(1)
    middle = np.stack([np.bincount(pieces.strand, axis) / long for axis in pieces.middles.T], 1)
    middle *= ACROSS
    some = middle[pieces.strand[rng.choice(len(pieces.strand), LOCKS)]]
    return np.asarray(KDTree(some).query(middle)[1])[pieces.strand]


def strands_of(pieces: Pieces, count: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """Rows of at most `count` pieces: whole strands in any order, those through the cells of the
    finest grid that leaves so many."""
    long, order = np.bincount(pieces.strand), rng.permutation(len(pieces.strand))
    chosen = more = np.zeros(0, np.intp)
    for size in np.geomspace(30, 0.5, 30):
        places = pieces.middles[order] + rng.uniform(0, size, (len(order), 3))  # no rows
        first = order[np.unique(cells(places, size), return_index=True)[1]]
        chosen, more = more, rng.permutation(np.unique(pieces.strand[first]))
        if long[more].sum() > count:
            break
    strands = np.concatenate([chosen, np.setdiff1d(more, chosen)])
    strands = rng.permutation(strands[np.cumsum(long[strands]) <= count])
    place = np.full(len(long), -1)
    place[strands] = np.arange(len(strands))
    rows = np.flatnonzero(place[pieces.strand] >= 0)
    return rows[np.argsort(place[pieces.strand[rows]], kind="stable")]


def cropped(assembly: Assembly, vertices: Floats, tint: Tint, count: int, seed: int) -> Hair:
    """A few millimetres of hair, thin where it ends."""
    rng = np.random.default_rng((seed, 3))
    cover = rooted.head_of_hair(assembly.face.neutral)
    skin, seen = vertices[:SKIN_VERTICES], np.tile(np.array(CROP_SEEN, "f4"), (SKIN_VERTICES, 1))
    linear = np.array(tint, np.float32) ** 2
    flow = rooted.down(skin)
    return rooted.hairs(assembly, vertices, cover, flow, seen, rooted.CROP, linear, count, rng)


def before(
    assembly: Assembly, vertices: Floats, worn: Cards, grown: Hair, tint: Tint, seed: int
) -> Hair:
    """Fine hairs along the hairline, that lie as the hair behind it does."""
    rng = np.random.default_rng((seed, 6))
    skin = vertices[:SKIN_VERTICES]
    apart, near = (np.asarray(x) for x in KDTree(grown.means).query(skin, k=NEAR))
    flow = axes(grown.quats)[near].mean(1)
    shade = np.interp(apart.mean(1), SHADE_MM, (1, SHADED))[:, None]
    seen = (shade * grown.seen[near].mean(1)).astype(np.float32)
    into = ((grown.means[near].mean(1) - skin) * flow).sum(1)
    flow *= np.where((into < 0) & (skin[:, 1] > 0), -1, 1)[:, None]  # from the edge into the hair
    cap = np.maximum(worn.cap, rooted.head_of_hair(assembly.face.neutral))
    normals, linear = assembly.normals(vertices)[:SKIN_VERTICES], np.array(tint, np.float32) ** 2
    density = rooted.edge(skin, hairline.feet(skin, normals, grown.means, hairline.LIES_MM), cap)
    style = rooted.CURLY if worn.texture is None else rooted.FINE
    args = density, flow, seen, style, linear, FINE_HAIRS
    return rooted.hairs(assembly, vertices, *args, rng)


def smoothed(points: Floats, seen: Floats, rng: np.random.Generator) -> Floats:
    """Light that reaches hair goes on through it: no hard shadows of single cards."""
    some = rng.permutation(len(points))[:SOME]
    near = some[KDTree(points[some]).query(points, k=min(NEAR, len(some)))[1]]
    return seen[near].mean(1).astype(np.float32)


def under(with_hair: Floats, bald: Floats) -> Floats:  # [U] shares of the sky -> [U] 0..1
    """Which skin hair lies over, by the light that it takes."""
    share = np.clip((0.5 - with_hair / np.maximum(bald, DARK)) / 0.4, 0, 1)
    return (share * (bald > DARK)).astype(np.float32)
