"""Gaussians without holes: lids that hide the eye, lips that end in a line, eyes whole when near.

The fit looks at pictures of 512 pixels, where a splat is blurred by a third of a millimetre, and
seldom at shut lids, the inside of a lip, ears or the nape. So it leaves Gaussians there narrower
than the space between them: an eye shines through its lid, the edge of an open mouth crumbles,
an iris seen near is uneven, as if it looked elsewhere, dots cover neck and ears, and shoulders
have holes.
"""

import numpy as np
from numpy.typing import NDArray

from render.decoder import mesh_parts
from render.decoder.posing import Posing
from render.decoder.surface import Surface, stretch
from render.types import AHEAD, Floats

NEIGHBOURS = 4
SHARE = 0.6  # smallest standard deviation, as a share of the distance to the neighbours
OPACITY = 0.9  # at least
# Skin is the face's where so much of it is, and so far inside its rim: at the rim the layer below
# ends, and skin is as wide as off the face.
WHOLLY, RIM_MM = 0.99, 6.0
LOOSE_SHARE, LOOSE_OPACITY = 0.52, 0.9  # of skin off the face
NECK_MM, NECK_SHARE = (-145.0, -95.0), 0.74  # height of the bare skin above a collar
HOLE = 1.15  # smallest standard deviation on lips, as a share of the way to the middle of a hole
LOOSE_HOLE = 1.0  # the same of skin off the face
LID_HOLE, FOLD_MM = 1.2, 6.5  # and of shut lids and the fold so near them: behind it is dark
LID_MM = 1.5  # they are no wider: those deep in a corner of an eye would show as smudges
HOLE_MM = 8.0  # a point farther than this from every Gaussian is not a hole
SIXTHS = [(2, 2, 2), (3, 3, 0), (3, 0, 3), (0, 3, 3), (4, 1, 1), (1, 4, 1), (1, 1, 4)]
PLACES = (np.array(SIXTHS) / 6).astype(np.float32)  # of a triangle
# The same of skin of the face that no layer lies below, as beside a nose, and so near to it.
WING_SHARE, WING_MM = 0.66, 1.6
LINING_MM = 6.0, 9.0  # of a mouth, behind the skin of the face: hidden, as it is
# mm forward on the mean face: between them the lower and the upper teeth fade away
MOLARS_MM = {"lower": (75.4, 83.4), "upper": (73.4, 81.4)}


def cover(
    head: Surface,
    opacities: Floats,  # [N]
    kinds: NDArray[np.integer],  # [N] see mesh_parts
    lids: NDArray[np.int32],  # vertices
    lips: NDArray[np.int32],  # vertices, and those behind them
    front: NDArray[np.int32],  # vertices of the face, which the fit knows
    layered: NDArray[np.bool_],  # [N] skin that a layer lies below
    posing: Posing,
    mean_face: Floats,  # [V, 3] mm at rest
) -> tuple[Floats, Floats]:
    """Widths [N] mm and opacities [N] that leave no holes in lids, lips, eyes, ears and neck."""
    from scipy.spatial import KDTree

    shut = posing.pose(posing.full_blink(), AHEAD, posing.rest(mean_face, sealed=True))
    _, _, areas = head.whole.normals(shut)
    shut_stretch = stretch(areas[head.triangle], head.rest_areas)
    points = head.interpolate @ shut[head.used]
    front = inner(head, kinds, front, mean_face)
    on_lids, on_lips = head.share_on(lids) > 0, head.share_on(lips) > 0
    on_face = head.share_on(front) > WHOLLY
    widths, opacities = head.scales.copy(), opacities.copy()
    beside = folded(head, lids, front, mean_face)
    by_lids = head.share_on(beside) > 0
    bare = ~layered & on_face
    by_bare = KDTree(points[bare]).query(points, distance_upper_bound=WING_MM)[0] < WING_MM
    neck = (points[:, 1] > NECK_MM[0]) & (points[:, 1] < NECK_MM[1])
    for kind in (mesh_parts.SKIN, mesh_parts.EYE):
        of_kind = kinds == kind
        covers = of_kind & (on_lids | on_lips | (kind == mesh_parts.EYE))
        loose = of_kind & ~(covers | on_face)
        wings = of_kind & on_face & ~covers & by_bare
        apart, wanted = np.zeros_like(widths), covers | loose | wings
        apart[wanted] = spacing(points[wanted], points[of_kind])
        if kind == mesh_parts.SKIN:
            skin = head.used[np.unique(head.interpolate[of_kind].indices)]
            for among, which, own, share, most in (
                (of_kind & on_lips, on_lips, lips, HOLE, np.inf),
                (of_kind & by_lids, by_lids, beside, LID_HOLE, LID_MM),
                (of_kind, loose, skin, LOOSE_HOLE, np.inf),
            ):
                around = head.whole.corners[np.isin(head.whole.corners, own).all(1)]
                places = (PLACES @ shut[around]).reshape(-1, 3)
                holes = np.zeros_like(widths)
                holes[among] = farthest(points[among], places.astype(np.float32))
                wide = np.where(which, np.minimum(share * holes / shut_stretch, most), 0)
                widths = np.maximum(widths, wide.astype(np.float32))
        for which, share, least in (
            (covers, SHARE, OPACITY),
            (loose, LOOSE_SHARE, LOOSE_OPACITY),
            (loose & neck, NECK_SHARE, LOOSE_OPACITY),
            (wings, WING_SHARE, OPACITY),
        ):
            widths[which] = np.maximum(widths, share * apart / shut_stretch)[which]
            opacities[which] = np.maximum(opacities[which], least)
    return widths, opacities


def folded(
    head: Surface, lids: NDArray[np.int32], front: NDArray[np.int32], mean_face: Floats
) -> NDArray[np.int32]:
    """Vertices of the lids and of the skin beside them."""
    from scipy.spatial import KDTree

    skin = np.intersect1d(head.used, front)
    found = KDTree(mean_face[lids]).query(mean_face[skin], distance_upper_bound=FOLD_MM)
    return skin[np.isfinite(found[0])]


def inner(
    head: Surface, kinds: NDArray[np.integer], front: NDArray[np.int32], mean_face: Floats
) -> NDArray[np.int32]:
    """Vertices of the face but for those near its rim: other skin."""
    from scipy.spatial import KDTree

    skin = np.unique(head.interpolate[kinds == mesh_parts.SKIN].indices)
    beyond = mean_face[np.setdiff1d(head.used[skin], front)]
    found = KDTree(beyond).query(mean_face[front], distance_upper_bound=RIM_MM)
    return front[np.isinf(found[0])]


def molars(
    head: Surface,
    teeth: NDArray[np.integer],  # rows of head.used
    mouth_mm: float,  # height of the lips
    mean_face: Floats,  # [V, 3] mm at rest
) -> Floats:  # [N] factor of the opacities
    """0 for teeth so far back that no picture of the fit showed them from inside: there they would
    be slivers, and the dark of the mouth is nearer to the truth."""
    rows = np.flatnonzero(head.share_on(head.used[teeth]) > 0.5)
    points = (head.interpolate @ mean_face[head.used])[rows]
    shown = np.ones(len(head.scales), np.float32)
    for side, of_side in (("lower", points[:, 1] < mouth_mm), ("upper", points[:, 1] >= mouth_mm)):
        back, front = MOLARS_MM[side]
        shown[rows[of_side]] = np.clip((points[of_side, 2] - back) / (front - back), 0, 1)
    return shown


def lining(
    head: Surface,
    inside: NDArray[np.bool_],  # [N] Gaussians of the mouth
    flesh: NDArray[np.integer],  # vertices of teeth, gums and tongue
    front: NDArray[np.integer],  # vertices of the face but for lids and the ends of lips
    posing: Posing,
    mean_face: Floats,  # [V, 3] mm at rest
) -> Floats:  # [N] factor of the opacities
    """0 for cheeks and lips seen from inside, close behind skin: few and wide, they come out
    before the layer below it and through its gaps, as sand under a lip when the jaw opens."""
    from scipy.spatial import KDTree

    shut = np.zeros_like(posing.full_blink())
    opened = shut.copy()
    opened[posing.jaw[0]] = 1
    low, high = LINING_MM
    rest, near = posing.rest(mean_face, sealed=True), np.full(len(head.scales), np.inf, np.float32)
    lines = inside & (head.share_on(flesh) < 0.01)
    skin = head.share_on(front) > WHOLLY
    for rig in (shut, opened):
        points = head.interpolate @ posing.pose(rig, AHEAD, rest)[head.used]
        found = KDTree(points[skin]).query(points[lines], distance_upper_bound=high)
        near[lines] = np.minimum(near[lines], found[0])
    return np.clip((near - low) / (high - low), 0, 1).astype(np.float32)


def farthest(points: Floats, places: Floats) -> Floats:  # [n, 3] mm, [p, 3] mm -> [n] mm
    """How far the places reach that no other point is nearer to."""
    from scipy.spatial import KDTree

    found = KDTree(points).query(places, distance_upper_bound=HOLE_MM)
    distance, nearest = (np.asarray(x) for x in found)
    near = np.isfinite(distance)
    out = np.zeros(len(points), np.float32)
    np.maximum.at(out, nearest[near], distance[near].astype(np.float32))
    return out


def spacing(points: Floats, among: Floats | None = None) -> Floats:  # [n, 3] mm -> [n] mm
    """Mean distance to the nearest neighbours, of these points or of more [m, 3] mm."""
    distance, _ = nearest(points if among is None else among, points, NEIGHBOURS + 1)
    return distance[:, 1:].mean(1).astype(np.float32)


def nearest(
    points: NDArray[np.floating],  # [n, D]
    queries: NDArray[np.floating],  # [q, D]
    count: int,
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:  # [q, count] each
    """Distances and rows of the points nearest to each query, nearest first.

    Queries are made in the order of a tree's leaves: one after another they read the same part of
    memory, which takes a third of the time.
    """
    from scipy.spatial import KDTree

    tree = KDTree(points)
    order = (tree if queries is points else KDTree(queries)).indices
    distance, rows = tree.query(queries[order], k=count)
    back, shape = np.argsort(order), (len(queries), count)
    return np.reshape(distance, shape)[back], np.reshape(rows, shape)[back]
