"""Loops of the mesh half of the decoder, compiled by numba as those of `surface.py` are."""

# pyright: reportUntypedFunctionDecorator=false
import numpy as np
from numba import njit
from numpy.typing import NDArray

from render.types import Floats, Ints

LANES = 16  # vertices that are moved together
WIDTH = 3 * LANES
EDGE_MM2 = np.float32(0.3)  # of the edge of a lid, about half a millimetre is looked at together
STATIONS = 24  # places across an eye where the edges of its lids are looked up


@njit(cache=True, nogil=True, error_model="numpy")
def blend(
    rest: Floats,  # [V * 3] mm
    starts: Ints,  # [V / LANES + 1] where the shapes of each block of vertices begin
    shapes: NDArray[np.uint8],  # [E]
    moves: NDArray[np.int16],  # [E, WIDTH] at full activation, in units of ...
    unit: np.float32,  # ... mm
    rig: Floats,  # [R]
    out: Floats,  # -> [V * 3] mm
) -> None:
    sums = np.empty(WIDTH, np.float32)
    for block in range(len(starts) - 1):
        for k in range(WIDTH):
            sums[k] = 0
        e, end = np.intp(starts[block]), np.intp(starts[block + 1])
        while e + 4 <= end:  # four at a time: the sums are read and written less often
            a, b, c, d = shapes[e], shapes[e + 1], shapes[e + 2], shapes[e + 3]
            p, q, r, s = rig[a], rig[b], rig[c], rig[d]
            for k in range(WIDTH):
                first = sums[k] + p * moves[e, k] + q * moves[e + 1, k]
                sums[k] = first + r * moves[e + 2, k] + s * moves[e + 3, k]
            e += 4
        while e < end:
            p = rig[shapes[e]]
            for k in range(WIDTH):
                sums[k] += p * moves[e, k]
            e += 1
        at = block * WIDTH
        for k in range(min(WIDTH, len(rest) - at)):
            out[at + k] = rest[at + k] + unit * sums[k]


@njit(cache=True, nogil=True, error_model="numpy")
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


@njit(cache=True, nogil=True, error_model="numpy")
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


@njit(cache=True, nogil=True, error_model="numpy")
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


@njit(cache=True, nogil=True, error_model="numpy")
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


@njit(cache=True, nogil=True, error_model="numpy")
def turn_eye(
    rest: Floats,  # [V, 3] mm
    members: Ints,  # [M] vertices of the eyeball
    center: Floats,  # [3] mm
    rotation: Floats,  # [3, 3]
    out: Floats,  # -> [V, 3] mm, these rows
) -> None:
    for member in members:
        v = np.uintp(member)
        x, y, z = rest[v, 0] - center[0], rest[v, 1] - center[1], rest[v, 2] - center[2]
        for k in range(3):
            turned = rotation[k, 0] * x + rotation[k, 1] * y + rotation[k, 2] * z
            out[v, k] = turned + center[k]


@njit(cache=True, nogil=True, error_model="numpy")
def height_at(
    vertices: Floats,  # [V, 3] mm
    members: Ints,  # [P] vertices along a line
    x: np.float32,  # mm
) -> np.float32:  # mm: the height of the line there, of those within about half a millimetre
    height = total = np.float32(0)
    for member in members:
        v = np.uintp(member)
        apart = vertices[v, 0] - x
        near = np.float32(1) / (apart * apart + EDGE_MM2)
        height += near * near * vertices[v, 1]
        total += near * near
    return height / total


@njit(cache=True, nogil=True, error_model="numpy")
def tint_covered(
    points: Floats,  # [n, 3] mm
    rows: NDArray[np.intp],  # [n] their colours
    vertices: Floats,  # [V, 3] mm
    upper: Ints,  # [P] vertices along the upper side of an opening, and ...
    lower: Ints,  # [P] ... along the lower side
    near: np.float32,  # mm behind the edge of a side up to which nothing changes
    far: np.float32,  # mm from where all is veiled
    color: Floats,  # [3]
    shade: Floats,  # [2, 3] how much darker right under the upper edge, over the lower one
    reach: Floats,  # [2] mm from the edges at which that is a quarter
    colors: Floats,  # [N, 3], changed in place
) -> None:
    one, zero = np.float32(1), np.float32(0)
    left = right = points[0, 0]
    for n in range(len(points)):
        left, right = min(left, points[n, 0]), max(right, points[n, 0])
    step = (right - left) / np.float32(STATIONS - 1)
    top, bottom = np.empty(STATIONS, np.float32), np.empty(STATIONS, np.float32)
    for k in range(STATIONS):
        top[k] = height_at(vertices, upper, left + np.float32(k) * step)
        bottom[k] = height_at(vertices, lower, left + np.float32(k) * step)
    for n in range(len(points)):
        row, place = rows[n], (points[n, 0] - left) / step
        if not 0 <= place < STATIONS:  # NaN, or an opening without width
            continue
        k = min(int(place), STATIONS - 2)
        part, y = place - np.float32(k), points[n, 1]
        above = y - (top[k] + part * (top[k + 1] - top[k]))
        below = bottom[k] + part * (bottom[k + 1] - bottom[k]) - y
        share = (max(above, below) - near) / (far - near)
        share = min(max(share, zero), one)
        under, over = max(-above, zero) / reach[0], max(-below, zero) / reach[1]
        under, over = one / (one + under * under), one / (one + over * over)
        under, over = under * under, over * over
        for c in range(3):
            lit = colors[row, c] * (one - shade[0, c] * under) * (one - shade[1, c] * over)
            colors[row, c] = lit + share * (color[c] - lit)
