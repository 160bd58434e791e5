"""Contact of skin with skin: lips that meet and lids that close, for any identity and expression.

Sums of blendshapes let the lips cross and leave lids ajar on faces they were not made for. Pairs of
facing vertices along the mouth and along each lid measure the gap; a crossing is undone by moving
both sides apart, with a soft falloff around the line. What a person needs to shut at all (`seal`
of the lips at rest, of the lids at a full blink) is part of the identity.
"""

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from render.decoder.kernels import contact
from render.decoder.kernels import posing as posing_kernels
from render.types import Floats, Ints

LID_CLEARANCE_MM = 0.35  # the inside of a lid stays this far above the eyeball
PUSH_PASSES = 2
PRESSED_MM, PRESSED_PASSES = np.float32(0.2), 3  # lips may cross by so much more than at rest
FACING_MM, FACING = 4.5, 8  # vertices of the other lip, so near at rest, that one may press into
VEILED_MM = (np.float32(1.0), np.float32(2.5))  # behind an edge, invisible from the side
# Of stored colours, upper and lower side: what a lid and its lashes keep from an eye.
SHADE = np.array([[0.28, 0.30, 0.31], [0.08, 0.10, 0.10]], np.float32)
AT_REST = np.eye(3, 4, dtype=np.float32)
SHADE_MM = np.array([2.4, 0.9], np.float32)


@dataclass(frozen=True)
class Line:
    """A line along which an upper and a lower side meet, cut into columns."""

    upper: Ints  # [P] vertices of the upper side that face ...
    lower: Ints  # [P] ... these of the lower side
    nearest: Ints  # [C, K] pairs around each column
    columns: Floats  # [C] place along the line, mm, rising
    members: Ints  # [M] vertices that are moved
    place: Floats  # [M] place along the line
    share: Floats  # [M] -1..1 share of the gap a vertex takes, its sign the way it moves to open

    def gaps(self, vertices: Floats) -> Floats:  # [V, 3] -> [C] mm, below zero where they cross
        """The gap at each column: the smallest of the pairs around it."""
        out = np.empty(len(self.columns), np.float32)
        contact.measure_gaps(vertices, self.upper, self.lower, self.nearest, out)
        return out

    def between_sides(
        self, vertices: Floats, points: Floats
    ) -> NDArray[np.bool_]:  # [V, 3], [P, 3]
        """Which points lie between the sides as seen from the front."""
        x = vertices[self.upper, 0][self.nearest].mean(1)
        order = np.argsort(x)
        top = vertices[self.upper, 1][self.nearest].min(1)[order]
        bottom = vertices[self.lower, 1][self.nearest].max(1)[order]
        x, across, height = x[order], points[:, 0], points[:, 1]
        below, above = height < np.interp(across, x, top), height > np.interp(across, x, bottom)
        return (across > x[0]) & (across < x[-1]) & below & above

    def clearance(self, vertices: Floats, point: Floats) -> float:  # [V, 3], [3] -> mm
        """How far inside the opening a point is as seen from the front; below zero: covered."""
        x, y = np.float32(point[0]), np.float32(point[1])
        return float(posing_kernels.clearance(vertices, self.upper, self.lower, x, y))

    def opening(self, vertices: Floats, points: Floats) -> Floats:  # [V, 3], [P, 3] -> [S, 3] mm
        """Heights of the upper and the lower edge at places across the points: x, both heights."""
        left, right = points[:, 0].min(), points[:, 0].max()
        across, step = np.linspace(
            left, right, posing_kernels.STATIONS, retstep=True, dtype=np.float32
        )
        sides = (
            posing_kernels.heights_from(vertices, side, np.float32(left), np.float32(step))
            for side in (self.upper, self.lower)
        )
        return np.stack([across, *sides], 1)

    def tint_covered(
        self,
        vertices: Floats,  # [V, 3] mm
        points: Floats,  # [N, 3] mm
        rows: NDArray[np.intp],  # [n] those behind the line
        color: Floats,  # [3]
        colors: Floats,  # [N, 3], changed in place
        move: Floats = AT_REST,  # [3, 4] how the points moved from where the vertices are
    ) -> None:
        """Give what the sides cover as seen from the front their colour: no cover is perfect.
        What is beside them lies in their shade."""
        sides = vertices, self.upper, self.lower
        shades = SHADE, SHADE_MM
        posing_kernels.tint_covered(points, rows, move, *sides, *VEILED_MM, color, *shades, colors)

    def open(self, vertices: Floats, by: Floats) -> None:
        """Move the sides apart by `by` [C] mm, in place."""
        contact.move_apart(vertices, self.members, self.share, *self.between, by)

    @cached_property
    def between(self) -> tuple[Ints, Floats]:
        """The column before each member, and how far it is towards the next: 0..1."""
        first = np.searchsorted(self.columns, self.place).clip(1, len(self.columns) - 1) - 1
        gap = self.columns[first + 1] - self.columns[first]
        share = ((self.place - self.columns[first]) / gap).clip(0, 1)
        return first.astype(np.int32), share.astype(np.float32)

    @cached_property
    def sides(self) -> contact.Sides:
        """What the loops in kernels/contact.py want to know of it."""
        pairs = self.upper, self.lower, self.nearest
        return (*pairs, self.members, self.share, *self.between)

    def tensors(self, prefix: str) -> dict[str, NDArray[np.generic]]:
        """For a weights file."""
        return {f"{prefix}_{f.name}": getattr(self, f.name) for f in fields(self)}

    @classmethod
    def of(cls, tensors: dict[str, NDArray], prefix: str) -> "Line":
        return cls(*(tensors[f"{prefix}_{f.name}"] for f in fields(cls)))


@dataclass(frozen=True)
class Lips:
    """Vertices of the lips that may press into each other, wherever on them they meet.

    `Line` knows the places that touch on the mean face. Lips of another shape, pressed or rolled
    in, meet elsewhere: there the vertices that crossed are moved, and only these.
    """

    members: Ints  # [M] vertices
    upper: Ints  # [P] rows of these that face ...
    lower: Ints  # [P] ... these

    @classmethod
    def of(cls, mean_face: Floats, upper: Ints, lower: Ints) -> "Lips":  # [V, 3] mm at rest
        upper = np.setdiff1d(upper, lower)
        apart = np.linalg.norm(mean_face[upper][:, None] - mean_face[lower][None], axis=2)
        columns = np.argsort(apart, axis=1)[:, :FACING]
        near = np.take_along_axis(apart, columns, 1) < FACING_MM
        rows = np.broadcast_to(np.arange(len(upper))[:, None], near.shape)[near]
        return cls(
            np.concatenate([upper, lower]).astype(np.int32),
            rows.astype(np.int32),
            (len(upper) + columns[near]).astype(np.int32),
        )


def undo_crossings(
    vertices: Floats,  # [V, 3] mm, changed in place
    rest: Floats,  # [V, 3] mm
    mouth: Line,
    lips: Lips,
    lids: tuple[Line, Line],
) -> None:
    """Lips meet wherever they meet, and lids shut, but neither crosses."""
    pressed = (lips.members, lips.upper, lips.lower), PRESSED_MM, PRESSED_PASSES
    both = lids[0].sides, lids[1].sides
    contact.undo_crossings(vertices, rest, mouth.sides, *pressed, both, PUSH_PASSES)


def eye_radius(eyeball: Floats, center: Floats) -> float:  # [n, 3], [3] -> mm
    return float(np.median(np.linalg.norm(eyeball - center, axis=1)))


def lid_reach(rest: Floats, lids: Ints, center: Floats, radius: float) -> Floats:  # -> [M] mm
    """How near each lid vertex may come: the eyeball, or where it is at rest if that is nearer."""
    distance = np.linalg.norm(rest[lids] - center, axis=1)
    return np.minimum(distance, radius + LID_CLEARANCE_MM).astype(np.float32)
