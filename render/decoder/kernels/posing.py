"""Loops of the mesh half of the decoder, compiled by numba as those of `surface.py` are."""

# pyright: reportUntypedFunctionDecorator=false
import numpy as np
from numpy.typing import NDArray

from render.decoder.kernels.vectors import loop
from render.types import Floats, Ints

LANES = 16  # vertices that are moved together
WIDTH = 3 * LANES
EDGE_MM2 = np.float32(0.3)  # of the edge of a lid, about half a millimetre is looked at together
STATIONS = 24  # places across an eye where the edges of its lids are looked up


@loop
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


@loop
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


@loop
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


@loop
def clearance(
    vertices: Floats,  # [V, 3] mm
    upper: Ints,  # vertices along the edge of an opening, and ...
    lower: Ints,  # ... along the other one
    x: np.float32,  # mm
    y: np.float32,  # mm
) -> np.float32:  # mm: how far inside the opening, seen from the front; below zero: covered
    return min(height_at(vertices, upper, x) - y, y - height_at(vertices, lower, x))


@loop
def place_highlight(
    vertices: Floats,  # [V, 3] mm
    upper: Ints,  # vertices along the edge of the upper lid, and ...
    lower: Ints,  # ... of the lower one
    pupil: Floats,  # [3] unit, the way it points
    half: Floats,  # [3] unit, between lamp and viewer
    center: Floats,  # [3] mm, of the eye
    size: np.float32,  # of this eye
    cornea_mm: np.float32,  # from that centre to the cornea's, on an eye of size 1
    radius_mm: np.float32,  # of such a cornea
    most: np.float32,  # of that radius, how far off the middle of an iris it may be
    mean: Floats,  # -> [3] mm
) -> np.float32:  # mm: its `clearance`
    one, along = np.float32(1), np.float32(0)
    for k in range(3):
        along += pupil[k] * half[k]
    off2 = np.float32(0)
    for k in range(3):
        off2 += (half[k] - along * pupil[k]) ** 2
    inside = min(one, most / max(np.sqrt(off2), np.float32(1e-6)))
    out = np.sqrt(max(one - off2 * inside * inside, np.float32(0)))
    for k in range(3):
        off = (half[k] - along * pupil[k]) * inside
        mean[k] = center[k] + size * ((cornea_mm + radius_mm * out) * pupil[k] + radius_mm * off)
    return clearance(vertices, upper, lower, mean[0], mean[1])


@loop
def heights_from(
    vertices: Floats,  # [V, 3] mm
    members: Ints,  # [P] vertices along a line
    left: np.float32,  # mm
    step: np.float32,  # mm
) -> Floats:  # [STATIONS] mm: `height_at` at even steps, all together
    heights, totals = np.zeros(STATIONS, np.float32), np.zeros(STATIONS, np.float32)
    for member in members:
        v = np.uintp(member)
        x, y = vertices[v, 0] - left, vertices[v, 1]
        for k in range(STATIONS):
            apart = x - np.float32(k) * step
            near = np.float32(1) / (apart * apart + EDGE_MM2)
            heights[k] += near * near * y
            totals[k] += near * near
    for k in range(STATIONS):
        heights[k] /= totals[k]
    return heights


@loop
def tint_covered(
    points: Floats,  # [N, 3] mm
    rows: NDArray[np.intp],  # [n] those behind the opening
    move: Floats,  # [3, 4] how the points moved from where the vertices are
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
    a, d, g = move[0, 0], move[1, 0], move[2, 0]
    b, e, h = move[0, 1], move[1, 1], move[2, 1]
    left, right = np.float32(np.inf), np.float32(-np.inf)
    across, height = np.empty(len(rows), np.float32), np.empty(len(rows), np.float32)
    for n in range(len(rows)):
        row = np.uintp(rows[n])
        x, y, z = points[row, 0] - move[0, 3], points[row, 1] - move[1, 3], points[row, 2]
        z -= move[2, 3]
        across[n], height[n] = a * x + d * y + g * z, b * x + e * y + h * z
        left, right = min(left, across[n]), max(right, across[n])
    step = (right - left) / np.float32(STATIONS - 1)
    top, bottom = (
        heights_from(vertices, upper, left, step),
        heights_from(vertices, lower, left, step),
    )
    steps, last = one / step, np.float32(STATIONS - 2)
    above, below = across, height
    for n in range(len(rows)):
        place, y = (across[n] - left) * steps, height[n]
        if not place > 0:  # NaN: an opening without width
            place = zero
        k = np.intp(min(place, last))
        part = place - np.float32(k)
        above[n] = y - (top[k] + part * (top[k + 1] - top[k]))
        below[n] = bottom[k] + part * (bottom[k + 1] - bottom[k]) - y
    veil, steep, flat = one / (far - near), one / reach[0], one / reach[1]
    shares, under, over = np.empty(len(rows), np.float32), above, below
    for n in range(len(rows)):
        shares[n] = min(max((max(above[n], below[n]) - near) * veil, zero), one)
        high, low = max(-above[n], zero) * steep, max(-below[n], zero) * flat
        high, low = one / (one + high * high), one / (one + low * low)
        under[n], over[n] = high * high, low * low
    for n in range(len(rows)):
        row, share = np.uintp(rows[n]), shares[n]
        for c in range(3):
            lit = colors[row, c] * (one - shade[0, c] * under[n]) * (one - shade[1, c] * over[n])
            colors[row, c] = lit + share * (color[c] - lit)
