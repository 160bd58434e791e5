"""The neck: a head that turns on a spine that bends, while the shoulders stay.

Seen from the head it is the neck and the shoulders that move: their vertices and normals go first,
by their share of the way from the head (1) to the chest (0), and the Gaussians on them follow. Then
everything turns with the head. Between its two joints the spine bends evenly, as cervical vertebrae
share a turn, so the neck keeps its thickness. Light falls on normals that are turned as well.
"""

from dataclasses import dataclass
from functools import cached_property
from math import atan2, sqrt, tanh
from typing import NamedTuple

import numpy as np

from render.decoder.kernels import neck as kernels
from render.types import Doubles, Floats, Ints
from sensors import rotation
from sensors.rotation import REST, Vector
from sensors.types import HeadPose

STEPS = 32  # of a turn along the spine
EYES_MM = (0.0, 36.5, 80.0)  # between the eyes of the mean face, where the rest is measured from
BASE_MM, JOINT_MM = (0.0, -140.0, -35.0), (0.0, -28.0, -5.0)  # seventh vertebra, skull on spine
# Two planes across the neck, y = height + slope * z: above the first all is head; below the second
# and out on the shoulders nothing moves.
HEAD_PLANE, CHEST_PLANE = (-62.0, -0.45), (-152.0, -0.36)
SHOULDER_MM = (52.0, 45.0)  # from the middle: where they begin, over what width they fade in
LIMITS_RAD = (0.95, 1.30, 0.75)  # pitch, yaw, roll of a human neck
LIMIT_MM = 30.0  # of a head that is pushed on its neck
FREE = 0.75  # share of a limit up to which nothing is drawn in
BREATH_MM = (0.0, 1.6, 0.7)  # how far a breath lifts the chest
RADIUS_MM = 45.0  # of a neck, for how far its skin is stretched


class Bent(NamedTuple):
    """A spine in one pose, from the chest to the head."""

    moves: Floats  # [STEPS + 1, 3, 4] in the room
    turns: Floats  # [STEPS + 1, 4] wxyz, the same as rotations
    from_head: Floats  # [STEPS + 1, 3, 4] seen from the head, which rests
    angle: float  # rad

    @property
    def head(self) -> Floats:  # [3, 4]
        """How the head moves."""
        return self.moves[-1]


class Share(NamedTuple):
    """Points that do not go with the head alone."""

    rows: Ints  # [n] of all points
    along: Floats  # [n] how far they go with it, 0..1


class RestSurface(NamedTuple):
    """What follows from a person at rest."""

    normals: Floats  # [U, 3] unit
    sums: Floats  # [L] twice the area around each live vertex
    widths: Floats  # [N] mm, at rest on the mean face where they follow a triangle


class TurnedHead(NamedTuple):
    """A head that is not at rest, for the skin."""

    bent: Bent
    share: Share  # of RestSurface.normals
    stretch: tuple[Ints, Floats]  # of which of the skin's Gaussians, a rad

    def surface(self, rest: RestSurface) -> RestSurface:
        """What rests, as the neck turns and stretches it, seen from the head."""
        normals, widths = rest.normals.copy(), rest.widths.copy()
        kernels.turn_normals(*self.share, self.bent.from_head, rest.normals, normals)
        kernels.widen(*self.stretch, np.float32(self.bent.angle), widths)
        return RestSurface(normals, rest.sums, widths)


@dataclass(frozen=True)
class Neck:
    """Of one person; holds no state."""

    eyes: Vector  # mm, the point between them

    def along(self, points: Floats) -> Floats:  # [n, 3] mm, at rest -> [n]
        """How far points go with the head: 0 shoulders .. 1 head."""
        x, y, z = (points - self.offset).T
        top = HEAD_PLANE[0] + HEAD_PLANE[1] * z
        bottom = CHEST_PLANE[0] + CHEST_PLANE[1] * z
        share = np.clip((y - bottom) / (top - bottom), 0, 1)
        out = np.clip((np.abs(x) - SHOULDER_MM[0]) / SHOULDER_MM[1], 0, 1)
        share = np.clip(share - out * (1 - share), 0, 1)
        return (share * share * (3 - 2 * share)).astype(np.float32)

    def share(self, points: Floats) -> Share:  # [n, 3] mm, at rest
        """Those of the points that are not quite on the head."""
        along = self.along(points)
        rows = np.flatnonzero(along < 1).astype(np.int32)
        return Share(rows, along[rows])

    def stretch(self, points: Floats) -> Floats:  # [n, 3] mm, at rest -> [n]
        """How far the skin around points is stretched, a rad of the head's turn."""
        steps = np.eye(3, dtype=np.float32)
        slopes = [(self.along(points + s) - self.along(points - s)) / 2 for s in steps]
        return (RADIUS_MM * np.linalg.norm(slopes, axis=0)).astype(np.float32)

    def bent(self, head: HeadPose, breath: float = 0.0) -> Bent:
        """The spine of a pose within human limits; `breath` 0..1 lifts the chest."""
        head = limited(head)
        w, x, y, z = head.quat if head.quat[0] >= 0 else tuple(-v for v in head.quat)
        sine = sqrt(x * x + y * y + z * z)
        angle, one = 2 * atan2(sine, w), sine or 1.0
        axis = (x / one, y / one, z / one)
        turns = np.empty((STEPS + 1, 4), np.float32)
        moves, from_head = np.empty((2, STEPS + 1, 3, 4), np.float32)
        pose = (angle, axis, head.position, breath, BREATH_MM)
        kernels.spine(self.spine, *pose, turns, moves, from_head)
        return Bent(moves, turns, from_head, angle)

    def stations(self, head: HeadPose, breath: float, count: int) -> Floats:  # [count, 3, 4]
        """How points move at even steps from the chest to the head, seen from the room; for
        those who turn the head themselves. `count` - 1 divides STEPS."""
        return self.bent(head, breath).moves[:: STEPS // (count - 1)]

    @cached_property
    def spine(self) -> Doubles:  # [STEPS + 1, 3] mm
        """From its base to the head's joint."""
        base, joint = np.array(BASE_MM), np.array(JOINT_MM)
        return base + np.linspace(0, 1, STEPS + 1)[:, None] * (joint - base) + self.offset

    @cached_property
    def offset(self) -> Vector:  # mm
        """From the eyes of the mean face to these."""
        x, y, z = (a - b for a, b in zip(self.eyes, EYES_MM, strict=True))
        return (x, y, z)


def bend_vertices(vertices: Floats, share: Share, bent: Bent) -> None:
    """Move vertices [V, 3] that do not go with the head, seen from there, in place."""
    kernels.bend(*share, bent.from_head, vertices, vertices)


def turn(means: Floats, quats: Floats, bent: Bent) -> None:  # [N, 3] mm, [N, 4]
    """Turn what goes with the head, in place."""
    kernels.turn(bent.head, bent.turns[-1], means, quats, means, quats)


def turn_hair(
    means: Floats,  # [N, 3] mm, at rest
    quats: Floats,  # [N, 4]
    share: Share,
    bent: Bent | None,
    out_means: Floats,  # -> [N, 3] mm
    out_quats: Floats,  # -> [N, 4]
) -> None:
    """Turn what goes with the head, but for those that do so in part; None: it rests."""
    if bent is None:
        out_means[:], out_quats[:] = means, quats
        return
    kernels.turn(bent.head, bent.turns[-1], means, quats, out_means, out_quats)
    kernels.bend(*share, bent.moves, means, out_means)
    kernels.turn_quats(*share, bent.turns, quats, out_quats)


def limited(head: HeadPose) -> HeadPose:
    """A pose that a neck can take; within FREE of every limit it stays as it is."""
    if head == REST:
        return head
    angles = rotation.to_angles(head.quat)
    inside = [_soft(a, limit) for a, limit in zip(angles, LIMITS_RAD, strict=True)]
    x, y, z = (_soft(v, LIMIT_MM) for v in head.position)
    if inside == list(angles):
        return HeadPose((x, y, z), head.quat)
    return HeadPose((x, y, z), rotation.from_angles((inside[0], inside[1], inside[2])))


def _soft(value: float, limit: float) -> float:
    free = FREE * limit
    beyond = abs(value) - free
    if beyond <= 0:
        return value
    drawn_in = free + (limit - free) * tanh(beyond / (limit - free))
    return drawn_in if value > 0 else -drawn_in
