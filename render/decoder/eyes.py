"""What an eye shows between its lids: the light on it, and one round highlight on each cornea."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from render.decoder.cover import WHOLLY
from render.decoder.kernels.posing import place_highlight
from render.decoder.posing import Posing, eye_rotation, sphere_centre
from render.decoder.surface import Surface
from render.lighting import KEY
from render.types import Floats

SOME_LIDS = 8  # one in so many tells the colour of a lid
LINING = 0.0  # cosine to the way out of an eye below which skin is on the inside of a lid
SHOWN = 0.6  # least light on what shows of an eye: a place in a corner may come out of its shade
RIM_DEG = (72.0, 88.0)  # from straight ahead: where an eyeball fades into the dark of its socket
OPACITY = 0.9  # of a highlight
# From the centre of an eye that comes EYE_MM forward; on larger eyes both are larger.
CORNEA_MM, CORNEA_RADIUS_MM, EYE_MM = np.float32(6.2), np.float32(10.5), 15.95
# Where a highlight is, seen from the front: that of the lower half of the box, which lids leave.
HALF = KEY.towards * (1, 0.5, 1) + (0, 0, 1)
HALF = (HALF / np.linalg.norm(HALF)).astype(np.float32)
ON_CORNEA = np.float32(0.42)  # of that radius, how far off the middle of an iris it may be
LID_COVERS_MM, LID_CLEARS_MM = -0.3, 0.6  # the highlight's way out from behind the edge of a lid


class EyeParts(NamedTuple):
    """Gaussians of one eye."""

    ball: NDArray[np.intp]
    covered: NDArray[np.intp]  # these and those on the inside of the lids, which no light reaches
    lid: NDArray[np.intp]  # some of those on the upper lid, which tell its colour


def build(
    head: Surface,
    posing: Posing,
    eyelids: NDArray[np.int32],  # vertices
    mesh: Floats,  # [V, 3] mm
) -> list[EyeParts]:
    normals, out = head.interpolate @ head.whole.normals(mesh)[0], list[EyeParts]()
    points = head.interpolate @ mesh[head.used]
    for ball, slides in zip(posing.eyeballs, posing.lids, strict=True):
        arm = points - sphere_centre(mesh[ball])
        inside = np.einsum("nk,nk->n", arm, normals) < LINING * np.linalg.norm(arm, axis=1)
        lid = head.share_on(np.intersect1d(eyelids, slides)) > WHOLLY
        of_ball = np.flatnonzero(head.share_on(ball) > WHOLLY)
        lining = np.flatnonzero(lid & inside)
        seen = np.flatnonzero(lid & ~inside & (arm[:, 1] > 0))[::SOME_LIDS]
        out.append(EyeParts(of_ball, np.concatenate([of_ball, lining]), seen))
    return out


def bared(posing: Posing, face: Floats) -> list[tuple[NDArray[np.int32], NDArray[np.int32]]]:
    """Vertices of each eyeball that show at rest, and those behind lids and head; face [V, 3]."""
    out = []
    for line, members in zip(posing.lid_lines, posing.eyeballs, strict=True):
        points = face[members]
        shows = line.between_sides(face, points) & (points[:, 2] > points[:, 2].mean())
        out.append((members[shows], members[~shows]))
    return out


def turned_out(head: Surface, posing: Posing, face: Floats, visibility: Floats) -> Floats:
    """The light [U, 2] at rest, for eyes that turn: what comes out from behind a lid is lit.

    The rim stays dark: no look brings it out, and it would shine through the skin of the socket.
    """
    row_of = np.full(len(face), -1, np.int32)
    row_of[head.used] = np.arange(len(head.used))
    visibility = visibility.copy()
    for (shows, hidden), members in zip(bared(posing, face), posing.eyeballs, strict=True):
        rows, hidden = row_of[shows], hidden[row_of[hidden] >= 0]
        arm = face[hidden] - sphere_centre(face[members])
        turn = np.degrees(np.arccos(arm[:, 2] / np.linalg.norm(arm, axis=1)))
        share = np.clip((RIM_DEG[1] - turn) / (RIM_DEG[1] - RIM_DEG[0]), 0, 1)[:, None]
        lit, dark = np.median(visibility[rows[rows >= 0]], axis=0), visibility[row_of[hidden]]
        visibility[row_of[hidden]] = dark + share * (lit - dark)
        rows = rows[rows >= 0]
        visibility[rows] = np.maximum(visibility[rows], SHOWN * lit)
    return visibility


def eye_sizes(posing: Posing, geometry: Floats, centers: Floats) -> Floats:  # -> [2]
    """How far forward both eyes of a face [V, 3] come, as shares of EYE_MM."""
    fronts = [geometry[eye, 2].max() for eye in posing.eyeballs]
    return ((np.array(fronts) - centers[:, 2]) / EYE_MM).astype(np.float32)


def place_highlights(
    posing: Posing,
    vertices: Floats,  # [V, 3] mm
    gaze: Floats,  # [2, 3] unit
    centers: Floats,  # [2, 3] mm
    sizes: Floats,  # [2]
    half: Floats,  # [3] unit: between lamp and viewer
    means: Floats,  # -> [2, 3] mm
    opacities: Floats,  # -> [2]
) -> None:
    for eye, line in enumerate(posing.lid_lines):
        pupil = np.ascontiguousarray(eye_rotation(gaze[eye], eye)[:, 2])
        sides = vertices, line.upper, line.lower, pupil, half, centers[eye], sizes[eye]
        clear = place_highlight(*sides, CORNEA_MM, CORNEA_RADIUS_MM, ON_CORNEA, means[eye])
        share = (clear - LID_COVERS_MM) / (LID_CLEARS_MM - LID_COVERS_MM)
        opacities[eye] = OPACITY * min(max(share, 0.0), 1.0)
