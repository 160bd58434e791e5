"""Loops of skin that meets skin, compiled by numba as those of `surface.py` are."""

# pyright: reportUntypedFunctionDecorator=false
import numpy as np

from render.decoder.kernels.vectors import loop
from render.types import Floats, Ints

# Of a Line: its sides, pairs around its columns, members, their shares, and where they lie between
# the columns, see lines.py.
Sides = tuple[Ints, Ints, Ints, Ints, Floats, Ints, Floats]


@loop
def measure_gaps(
    vertices: Floats,  # [V, 3] mm
    upper: Ints,  # [P] vertices that face ...
    lower: Ints,  # [P] ... these
    nearest: Ints,  # [C, K] pairs
    out: Floats,  # -> [C] mm, the smallest of the pairs
) -> None:
    for c in range(len(nearest)):
        smallest = np.float32(np.inf)
        for pair in nearest[c]:
            smallest = min(smallest, vertices[upper[pair], 1] - vertices[lower[pair], 1])
        out[c] = smallest


@loop
def move_apart(
    vertices: Floats,  # [V, 3] mm, changed in place
    members: Ints,  # [M] vertices
    shares: Floats,  # [M]
    first: Ints,  # [M] the column before each member, and ...
    between: Floats,  # [M] ... how far it is towards the next: 0..1
    by: Floats,  # [C] mm
) -> None:
    for m in range(len(members)):
        low, high = by[first[m]], by[first[m] + 1]
        vertices[members[m], 1] += shares[m] * (low + between[m] * (high - low))


@loop
def unpress(
    vertices: Floats,  # [V, 3] mm, changed in place
    rest: Floats,  # [V, 3] mm, of the same person
    members: Ints,  # [M] vertices of both lips
    upper: Ints,  # [P] rows of these that face ...
    lower: Ints,  # [P] ... these
    least: np.float32,  # mm that may cross, more than at rest
    passes: int,
) -> None:
    """Each vertex goes half of the way out of the deepest of its pairs."""
    zero, half = np.float32(0), np.float32(0.5)
    for _ in range(passes):
        by, deepest = np.zeros(len(members), np.float32), zero
        for pair in range(len(upper)):
            i, j = np.uintp(upper[pair]), np.uintp(lower[pair])
            u, v = np.uintp(members[i]), np.uintp(members[j])
            allowed = min(rest[u, 1] - rest[v, 1], zero) - least
            deep = half * (allowed - (vertices[u, 1] - vertices[v, 1]))
            by[i], by[j] = max(by[i], deep), min(by[j], -deep)
            deepest = max(deepest, deep)
        if deepest <= zero:
            return
        for m in range(len(members)):
            vertices[np.uintp(members[m]), 1] += by[m]


@loop
def push_out(
    vertices: Floats,  # [V, 3] mm, changed in place
    members: Ints,  # [M] vertices
    reach: Floats,  # [M] mm from the centre below which they may not come
    center: Floats,  # [3] mm
) -> None:
    for m in range(len(members)):
        v = members[m]
        x = vertices[v, 0] - center[0]
        y = vertices[v, 1] - center[1]
        z = vertices[v, 2] - center[2]
        distance = np.sqrt(x * x + y * y + z * z)
        if distance < reach[m]:
            scale = reach[m] / distance
            vertices[v, 0] = center[0] + x * scale
            vertices[v, 1] = center[1] + y * scale
            vertices[v, 2] = center[2] + z * scale


@loop
def part(vertices: Floats, line: Sides, passes: int) -> None:  # [V, 3] mm, changed in place
    """Undo a crossing."""
    upper, lower, nearest, members, shares, first, between = line
    gaps = np.empty(len(nearest), np.float32)
    for _ in range(passes):
        measure_gaps(vertices, upper, lower, nearest, gaps)
        crossed = False
        for c in range(len(gaps)):
            crossed |= not gaps[c] >= np.float32(0)
            gaps[c] = max(-gaps[c], np.float32(0))
        if not crossed:
            return
        move_apart(vertices, members, shares, first, between, gaps)


@loop
def shut_lids(
    vertices: Floats,  # [V, 3] mm, changed in place
    lines: tuple[Sides, Sides],  # of both eyes
    shut: Floats,  # [2, C] mm that they open more, in this blink
    lids: tuple[Ints, Ints],  # vertices that slide on each eyeball
    reach: tuple[Floats, Floats],  # mm, see `push_out`
    centers: Floats,  # [2, 3] mm
) -> None:
    for eye in range(2):
        _, _, _, members, shares, first, between = lines[eye]
        move_apart(vertices, members, shares, first, between, shut[eye])
        push_out(vertices, lids[eye], reach[eye], centers[eye])


@loop
def undo_crossings(
    vertices: Floats,  # [V, 3] mm, changed in place
    rest: Floats,  # [V, 3] mm
    mouth: Sides,
    lips: tuple[Ints, Ints, Ints],  # see `unpress`
    pressed_mm: np.float32,
    pressed_passes: int,
    lids: tuple[Sides, Sides],
    passes: int,
) -> None:
    """Of lips, wherever they meet, then of lids; all in one call, as calls cost as much."""
    part(vertices, mouth, passes)
    members, upper, lower = lips
    unpress(vertices, rest, members, upper, lower, pressed_mm, pressed_passes)
    for eye in range(2):
        part(vertices, lids[eye], passes)
