"""How a head changes with age: temples, cheeks and lips lose fat, what is left sags."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from render.decoder.mesh_parts import SKIN_VERTICES
from render.types import Floats, Ints

Triple = tuple[float, float, float]
# On both sides of the mean face, mm: middle, half widths, move (outward, up, forward) at age 1.
SPOTS: tuple[tuple[Triple, Triple, Triple], ...] = (
    ((64, 50, 62), (15, 20, 24), (-3.2, 0, -1.5)),  # temples
    ((47, -16, 84), (13, 14, 20), (-3.0, -1.0, -2.6)),  # hollow cheeks
    ((44, -57, 76), (11, 10, 16), (1.6, -3.6, 1.3)),  # jowls
    ((27, -66, 90), (7, 8, 12), (0, 0.6, -1.3)),  # the dent before them
    ((31, -6, 102), (9, 11, 12), (0.5, -2.2, 1.8)),  # what hangs over the fold beside the nose
    ((28, -44, 101), (5, 9, 10), (0, -1.2, -2.0)),  # below the corners of the mouth
    ((25, -35, 102), (7, 6, 9), (0, -1.0, -0.4)),  # the corners
    ((40, 50, 93), (14, 6, 12), (0, -3.2, 1.2)),  # upper lids
    ((31, 24, 93), (13, 4.5, 10), (0, -0.6, 1.6)),  # bags
    ((31, 15, 95), (15, 4.5, 10), (0, 0, -1.8)),  # below them
    ((0, 0, 128), (12, 12, 14), (0, -2.4, 0)),  # tip of the nose
    ((0, -92, 66), (30, 14, 30), (0, -5.0, 0)),  # below the chin
    ((80, 2, 20), (14, 13, 16), (0, -3.5, 0)),  # lobes of the ears
)
LIPS_MM, LIPS_HALF_MM, THINNER, BACK_MM = -34.0, (25.0, 9.0), 0.36, 1.8
LID_EDGES = (range(36, 42), range(42, 48))  # of the 68 landmarks
CLEAR_MM = 3.0, 5.0  # of the edges of the lids, which shut as before; over what width moves begin


def aged(
    neutral: Floats,  # [V, 3] mm, the mean face
    landmarks: Ints,  # [68] vertices
    vertices: Floats,  # [V, 3] mm
    age: float,  # 0 young .. 1 old
) -> Floats:  # [V, 3] mm
    """The head of somebody so old."""
    points = neutral[:SKIN_VERTICES].astype(np.float64)
    across = np.abs(points) * (1, 0, 0) + points * (0, 1, 1)
    moves = np.zeros_like(points)
    for middle, half, move in SPOTS:
        near = np.exp(-(((across - middle) / half) ** 2).sum(1))
        moves += near[:, None] * move
    moves[:, 0] *= np.clip(points[:, 0] / 4, -1, 1)
    moves *= np.clip((_from_lids(neutral[landmarks], points) - CLEAR_MM[0]) / CLEAR_MM[1], 0, 1)[
        :, None
    ]
    up = points[:, 1] - LIPS_MM
    lips = np.exp(-((points[:, 0] / LIPS_HALF_MM[0]) ** 4)) * (points[:, 2] > 85)
    moves[:, 1] -= THINNER * up * lips * np.exp(-((up / LIPS_HALF_MM[1]) ** 4))
    moves[:, 2] -= BACK_MM * lips * np.exp(-((up / LIPS_HALF_MM[1]) ** 2))
    out = vertices.copy()
    out[:SKIN_VERTICES] += np.float32(age) * moves.astype(np.float32)
    return out


def _from_lids(marks: Floats, points: NDArray[np.float64]) -> NDArray[np.float64]:  # [n] mm
    """The distance from the edges of the lids; `marks` [68, 3] mm."""
    shares = np.linspace(0, 1, 8, endpoint=False)[:, None, None]
    edges = []
    for ring in LID_EDGES:
        corners = marks[list(ring)].astype(np.float64)
        edges.append((corners + shares * (np.roll(corners, -1, 0) - corners)).reshape(-1, 3))
    return np.asarray(KDTree(np.concatenate(edges)).query(points)[0])
