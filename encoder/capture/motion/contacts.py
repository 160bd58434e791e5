"""Contacts of the mouth on the mesh: do the lips meet, does the lower lip touch the teeth?

Part of the motion rules. The app hands over the decoder's vertices as numbers (`LipGeometry`),
so the rules close the lips of the very faces that will be drawn.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from encoder.capture.motion.channels import RIG_INDEX, RIG_NAMES

COLUMNS_MM = (-10.0, -5.0, 0.0, 5.0, 10.0)  # where across the mouth the gap is looked at
COLUMN_HALF_MM = 2.0
SHUT_MM = -0.15  # where closing lips are driven: a light overlap, so that every face is shut
CLOSE = RIG_INDEX["mouthClose"]


@dataclass(frozen=True)
class LipGeometry:
    """Heights of lip vertices as functions of the rig, of every face that must close its mouth.

    `upper[k]` and `lower[k]` index the vertices of column k; the gap there is the lowest upper
    vertex minus the highest lower one.
    """

    heights: np.ndarray  # [I, N] mm at rest, one row a face
    basis: np.ndarray  # [N, 53] mm a unit of each channel
    upper: list[np.ndarray]
    lower: list[np.ndarray]
    members: np.ndarray  # [N] the vertices' indices in the mesh

    def gap_mm(self, rig: np.ndarray) -> np.ndarray:
        """[T, 53] -> [T] the widest gap over the columns and faces; negative: lips overlap."""
        moved = rig.astype(np.float32) @ self.basis.T
        widest = np.full(len(rig), -np.inf, np.float32)
        for rest in self.heights:
            height = moved + rest
            for up, low in zip(self.upper, self.lower, strict=True):
                np.maximum(widest, height[:, up].min(1) - height[:, low].max(1), out=widest)
        return widest

    def gap_on(self, vertices: np.ndarray) -> float:
        """The widest gap of one face's posed vertices [V, 3], without the basis."""
        height = vertices[self.members, 1]
        pairs = zip(self.upper, self.lower, strict=True)
        return max(float(height[up].min() - height[low].max()) for up, low in pairs)

    def closed(self, rig: np.ndarray, target_mm: np.ndarray) -> np.ndarray:
        """[T, 53], gaps to reach [T] -> [T] the mouthClose that reaches them, 0 if not needed."""
        work = rig.copy()
        work[:, CLOSE] = 0
        gap = self.gap_mm(work)
        close = np.zeros(len(rig), np.float32)
        for _ in range(4):
            close = np.clip(close + (gap - target_mm) / SLOPE_MM, 0, 1)
            work[:, CLOSE] = close
            gap = self.gap_mm(work)
        return close


SLOPE_MM = 37.2  # millimetres that a unit of mouthClose closes


def lip_geometry(
    vertices: Callable[[np.ndarray], Sequence[np.ndarray]],
    upper: np.ndarray,
    lower: np.ndarray,
) -> LipGeometry:
    """Read the geometry off `vertices`: rig [53] -> the vertices [V, 3] mm of every face.

    `upper` and `lower` are the vertex sets of the lips.
    """
    rest = vertices(np.zeros(len(RIG_NAMES), np.float32))
    columns = []
    for members in (upper, lower):
        x = rest[0][members, 0]
        columns.append([members[np.abs(x - at) < COLUMN_HALF_MM] for at in COLUMNS_MM])
    chosen = np.unique(np.concatenate([m for side in columns for m in side]))
    where = {int(v): i for i, v in enumerate(chosen)}
    basis = _effects(vertices, chosen)[..., 1]
    indexed = [[np.array([where[int(v)] for v in m]) for m in side] for side in columns]
    heights = np.stack([face[chosen, 1] for face in rest])
    return LipGeometry(heights, basis, indexed[0], indexed[1], chosen)


def _effects(
    vertices: Callable[[np.ndarray], Sequence[np.ndarray]], members: np.ndarray
) -> np.ndarray:
    """[N, 53, 3] mm a unit of each channel, from the first face with its mouth open.

    Open, because the decoder keeps shut lips from crossing and lets mouthClose undo only as much
    as the jaw has opened; apart from that its blendshapes are linear.
    """
    base = np.zeros(len(RIG_NAMES), np.float32)
    base[RIG_INDEX["jawOpen"]] = 0.4
    start = vertices(base)[0][members]
    effects = np.empty((len(members), len(RIG_NAMES), 3), np.float32)
    for channel in range(len(RIG_NAMES)):
        rig = base.copy()
        rig[channel] += 0.2
        effects[:, channel] = (vertices(rig)[0][members] - start) / 0.2
    return effects


@dataclass(frozen=True)
class TeethGeometry:
    """The lower lip and the edge of the upper incisors, of every face; teeth do not move."""

    lip: np.ndarray  # [I, N, 3] mm at rest
    basis: np.ndarray  # [N, 3, 53] mm a unit of each channel
    edge: list[np.ndarray]  # of each face [M, 3] mm

    def distance_mm(self, rig: np.ndarray) -> np.ndarray:
        """[T, 53] -> [T] from the lower lip to the teeth, of the face where it is farthest."""
        moved = np.einsum("tc,nkc->tnk", rig.astype(np.float32), self.basis)
        worst = np.zeros(len(rig), np.float32)
        for rest, edge in zip(self.lip, self.edge, strict=True):
            lip = moved + rest  # [T, N, 3]
            squared = (lip**2).sum(-1)[..., None] + (edge**2).sum(-1) - 2 * lip @ edge.T
            worst = np.maximum(worst, np.sqrt(np.maximum(squared.min((1, 2)), 0)))
        return worst


def teeth_geometry(
    vertices: Callable[[np.ndarray], Sequence[np.ndarray]],
    lower: np.ndarray,
    teeth: np.ndarray,
) -> TeethGeometry:
    """As `lip_geometry`; `lower` is the lower lip's vertex set, `teeth` that of the upper jaw."""
    rest = vertices(np.zeros(len(RIG_NAMES), np.float32))
    members = lower[np.abs(rest[0][lower, 0]) < 10]
    basis = np.moveaxis(_effects(vertices, members), 1, 2)
    edges = []
    for face in rest:
        front = face[teeth][np.abs(face[teeth, 0]) < 9]
        edges.append(front[front[:, 1] < front[:, 1].min() + 1.5])
    return TeethGeometry(np.stack([face[members] for face in rest]), basis, edges)
