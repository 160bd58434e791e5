"""Gaussians without holes: lids that hide the eye, lips that end in a line, eyes whole when near.

The fit looks at pictures of 512 pixels, where a splat is blurred by a third of a millimetre, and
seldom at shut lids, the inside of a lip, ears or the nape. So it leaves Gaussians there narrower
than the space between them: an eye shines through its lid, the edge of an open mouth crumbles,
an iris seen near is uneven, as if it looked elsewhere, dots cover neck and ears, and shoulders
have holes.
"""

import numpy as np
from numpy.typing import NDArray

from render import mesh_parts
from render.posing import Posing, sphere_centre
from render.surface import Surface, stretched
from render.types import AHEAD

Floats = NDArray[np.float32]
NEIGHBOURS = 4
SHARE = 0.6  # smallest standard deviation, as a share of the distance to the neighbours
OPACITY = 0.9  # at least
LOOSE_SHARE, LOOSE_OPACITY = 0.45, 0.9  # of skin off the face
# Shoulders: below it, and no steeper (a wider neck would show). There the mesh is coarse: widths
# reach its bare places, which are no holes if further off
BUST_MM, SLOPE, HOLE_MM = -85.0, 0.35, 8.0
SIXTHS = [(2, 2, 2), (3, 3, 0), (3, 0, 3), (0, 3, 3), (4, 1, 1), (1, 4, 1), (1, 1, 4)]
PLACES = (np.array(SIXTHS) / 6).astype(np.float32)  # of a triangle
# mm before the teeth furthest back: between them the lower and the upper ones fade away
MOLARS_MM = {"lower": (19.0, 25.0), "upper": (8.0, 16.0)}
LASH_WIDTH, LASH_OPACITY = 1.8, 0.35  # factors of the lower lashes
RIM_DEG = (48.0, 66.0)  # from straight ahead: where an eyeball fades into the dark of its socket


def cover(
    head: Surface,
    opacities: Floats,  # [N]
    kinds: NDArray[np.integer],  # [N] see mesh_parts
    edges: NDArray[np.int32],  # vertices of lids and lips
    front: NDArray[np.int32],  # vertices of the face, which the fit knows
    posing: Posing,
    mean_face: Floats,  # [V, 3] mm at rest
) -> tuple[Floats, Floats]:
    """Widths [N] mm and opacities [N] that leave no holes in lids, lips, eyes, ears and neck.

    Lashes below the eye are few and thin: they are a soft shade, where they would be dots.
    """
    shut = posing.pose(posing.full_blink(), AHEAD, posing.rest(mean_face, sealed=True))
    normals, _, areas = head.whole.normals(shut)
    stretch = stretched(areas[head.triangle], head.rest_areas)
    points = head.interpolate @ shut[head.used]
    on_edge, on_face = (
        head.interpolate @ np.isin(head.used, v).astype(np.float32) > 0 for v in (edges, front)
    )
    widths, opacities = head.scales.copy(), opacities.copy()
    for kind in (mesh_parts.SKIN, mesh_parts.EYE):
        of_kind = kinds == kind
        apart = np.zeros_like(widths)
        apart[of_kind] = spacing(points[of_kind])
        covers = of_kind & (on_edge | (kind == mesh_parts.EYE))
        loose = of_kind & ~(covers | on_face)
        for which, share, least in (
            (covers, SHARE, OPACITY),
            (loose, LOOSE_SHARE, LOOSE_OPACITY),
        ):
            widths[which] = np.maximum(widths, share * apart / stretch)[which]
            opacities[which] = np.maximum(opacities[which], least)
    flat = (head.interpolate @ normals)[:, 1] > SLOPE
    rows = np.flatnonzero((kinds == mesh_parts.SKIN) & flat & (points[:, 1] < BUST_MM))
    places = PLACES @ shut[head.whole.corners]
    reach = farthest(points[rows], places.reshape(-1, 3))
    widths[rows] = np.maximum(widths[rows], reach / stretch[rows])
    eyes_mm = mean_face[np.concatenate(posing.eyeballs), 1].mean()
    low = (head.interpolate @ mean_face[head.used])[:, 1] < eyes_mm - 1
    lower_lashes = low & (kinds == mesh_parts.LASHES)
    widths[lower_lashes] *= LASH_WIDTH
    opacities[lower_lashes] *= LASH_OPACITY
    return widths, opacities


def molars(
    head: Surface,
    teeth: NDArray[np.integer],  # rows of head.used
    mouth_mm: float,  # height of the lips
    mean_face: Floats,  # [V, 3] mm at rest
) -> Floats:  # [N] factor of the opacities
    """0 for teeth so far back that no picture of the fit showed them from inside: there they would
    be slivers, and the dark of the mouth is nearer to the truth."""
    on_teeth = np.zeros(len(head.used), np.float32)
    on_teeth[teeth] = 1
    rows = np.flatnonzero(head.interpolate @ on_teeth > 0.5)
    points = (head.interpolate @ mean_face[head.used])[rows]
    forward = points[:, 2] - mean_face[head.used[teeth], 2].min()
    shown = np.ones(len(head.scales), np.float32)
    for side, of_side in (("lower", points[:, 1] < mouth_mm), ("upper", points[:, 1] >= mouth_mm)):
        back, front = MOLARS_MM[side]
        shown[rows[of_side]] = np.clip((forward[of_side] - back) / (front - back), 0, 1)
    return shown


def bared(posing: Posing, face: Floats) -> list[tuple[NDArray[np.int32], NDArray[np.int32]]]:
    """Vertices of each eyeball that show at rest, and those behind lids and head; face [V, 3]."""
    out = []
    for line, members in zip(posing.lid_lines, posing.eyeballs, strict=True):
        points = face[members]
        shows = line.parted(face, points) & (points[:, 2] > points[:, 2].mean())
        out.append((members[shows], members[~shows]))
    return out


def turned_out(head: Surface, posing: Posing, face: Floats, seen: Floats) -> Floats:
    """The light [U, 2] at rest, for eyes that turn: what comes out from behind a lid is lit.

    The rim stays dark: no look brings it out, and it would shine through the skin of the socket.
    """
    row_of = np.full(len(face), -1, np.int32)
    row_of[head.used] = np.arange(len(head.used))
    seen = seen.copy()
    for (shows, hidden), members in zip(bared(posing, face), posing.eyeballs, strict=True):
        rows, hidden = row_of[shows], hidden[row_of[hidden] >= 0]
        arm = face[hidden] - sphere_centre(face[members])
        turn = np.degrees(np.arccos(arm[:, 2] / np.linalg.norm(arm, axis=1)))
        share = np.clip((RIM_DEG[1] - turn) / (RIM_DEG[1] - RIM_DEG[0]), 0, 1)[:, None]
        lit, dark = np.median(seen[rows[rows >= 0]], axis=0), seen[row_of[hidden]]
        seen[row_of[hidden]] = dark + share * (lit - dark)
    return seen


def farthest(points: Floats, places: Floats) -> Floats:  # [n, 3] mm, [p, 3] mm -> [n] mm
    """How far the places reach that no other point is nearer to."""
    from scipy.spatial import KDTree

    found = KDTree(points).query(places, distance_upper_bound=HOLE_MM)
    distance, nearest = (np.asarray(x) for x in found)
    near = np.isfinite(distance)
    out = np.zeros(len(points), np.float32)
    np.maximum.at(out, nearest[near], distance[near].astype(np.float32))
    return out


def spacing(points: Floats) -> Floats:  # [n, 3] mm -> [n] mm
    """Mean distance to the nearest neighbours."""
    from scipy.spatial import KDTree

    distance, _ = KDTree(points).query(points, k=NEIGHBOURS + 1)
    return distance[:, 1:].mean(1).astype(np.float32)
