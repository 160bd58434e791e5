"""Loops of the decoder and of the tile renderer: one pass over memory where numpy takes many.

numba compiles them on first use (seconds, once a machine) and keeps the result beside this file.
All run on one thread and add in a fixed order: the same input gives the same bits.
"""

# pyright: reportUntypedFunctionDecorator=false
import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float32]
Ints = NDArray[np.int32]
WHOLE = np.uint8(255)  # byte of a row: the splat reaches every tile of its box


@njit(cache=True, nogil=True, error_model="numpy")
def around_vertices(
    vertices: Floats,  # [V, 3] mm
    corners: Ints,  # [F, 3] vertices of the triangles
    rows: Ints,  # [F, 3] where their corners are gathered, or -1
    normals: Floats,  # -> [n, 3] sum of the crossed edges around each vertex
    sums: Floats,  # -> [n] sum of twice the areas around it
    areas: Floats,  # -> [F] mm^2, twice those of the triangles
) -> None:
    normals[:] = 0
    sums[:] = 0
    for f in range(len(corners)):
        a, b, c = corners[f, 0], corners[f, 1], corners[f, 2]
        ax, ay, az = vertices[a, 0], vertices[a, 1], vertices[a, 2]
        bx, by, bz = vertices[b, 0] - ax, vertices[b, 1] - ay, vertices[b, 2] - az
        cx, cy, cz = vertices[c, 0] - ax, vertices[c, 1] - ay, vertices[c, 2] - az
        x, y, z = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
        area = np.sqrt(x * x + y * y + z * z)
        areas[f] = area
        for k in range(3):
            row = rows[f, k]
            if row >= 0:
                normals[row, 0] += x
                normals[row, 1] += y
                normals[row, 2] += z
                sums[row] += area


@njit(cache=True, nogil=True, error_model="numpy")
def ride(
    vertices: Floats,  # [V, 3] mm
    quats: Floats,  # [U, 4]
    light: Floats,  # [U, 4]
    corners: Ints,  # [N, 3] vertices of the anchors' triangles, and ...
    rows: Ints,  # [N, 3] ... their rows of `quats` and `light`
    weights: Floats,  # [N, 3] barycentric coordinates
    out_means: Floats,  # -> [N, 3] mm
    out_quats: Floats,  # -> [N, 4]
    out_light: Floats,  # -> [N, 4]
) -> None:
    for n in range(len(corners)):
        p, q, r = weights[n, 0], weights[n, 1], weights[n, 2]
        a, b, c = corners[n, 0], corners[n, 1], corners[n, 2]
        for k in range(3):
            out_means[n, k] = p * vertices[a, k] + q * vertices[b, k] + r * vertices[c, k]
        a, b, c = rows[n, 0], rows[n, 1], rows[n, 2]
        for k in range(4):
            out_quats[n, k] = p * quats[a, k] + q * quats[b, k] + r * quats[c, k]
        for k in range(4):
            out_light[n, k] = p * light[a, k] + q * light[b, k] + r * light[c, k]


@njit(cache=True, nogil=True, error_model="numpy")
def paint(
    reflected: Floats,  # [N, 3] linear albedo
    light: Floats,  # [N, 4] linear red, green, blue on a white surface; shine
    colors: Floats,  # -> [N, 3] stored, 0..1
) -> None:
    for n in range(len(colors)):
        for k in range(3):
            value = reflected[n, k] * light[n, k] + light[n, 3]
            colors[n, k] = np.sqrt(min(max(value, np.float32(0)), np.float32(1)))


@njit(cache=True, nogil=True)
def nearest_first(
    bits: NDArray[np.uint32],  # [N] of depths, which sort like the floats they are: all positive
    hidden: np.uint32,  # those from here on are left out
    order: NDArray[np.uint32],  # -> [N] indices, nearest first, equal ones as they come
    work: NDArray[np.uint32],  # [N]
) -> int:  # how many
    """A radix sort of three times 11 bits: half the time of numpy's."""
    counts = np.zeros((3, 2049), np.uint32)
    total = 0
    for i in range(len(bits)):
        key = bits[i]
        if key < hidden:
            work[total] = i
            total += 1
            for digit in range(3):
                counts[digit, np.uintp((key >> (11 * digit)) & 2047) + 1] += 1
    source, target = work, order
    for digit in range(3):
        places = np.cumsum(counts[digit])
        for n in range(total):
            i = source[n]
            place = np.uintp((bits[i] >> (11 * digit)) & 2047)
            target[places[place]] = i
            places[place] += 1
        source, target = target, source
    return total


@njit(cache=True, nogil=True)
def count_tiles(
    boxes: NDArray[np.uint32],  # [M, 2 or more] tiles: x0 | y0 << 16, x1 | y1 << 16
    rows: NDArray[np.uint8],  # [M, 8] left out << 4 | reached, or WHOLE
    across: int,
    counts: NDArray[np.uint32],  # -> [tiles] splats that reach each tile
) -> None:
    counts[:] = 0
    for m in range(len(boxes)):
        x0, y0 = int(boxes[m, 0] & 0xFFFF), int(boxes[m, 0] >> 16)
        x1, y1 = int(boxes[m, 1] & 0xFFFF), int(boxes[m, 1] >> 16)
        if rows[m, 0] == WHOLE:
            for y in range(y0, y1):
                for tile in range(np.uintp(y * across + x0), np.uintp(y * across + x1)):
                    counts[tile] += 1
        else:
            for k in range(y1 - y0):
                row = rows[m, k]
                first = np.uintp((y0 + k) * across + x0 + int(row >> 4))
                for tile in range(first, first + np.uintp(row & 15)):
                    counts[tile] += 1


@njit(cache=True, nogil=True)
def deal_to_tiles(
    boxes: NDArray[np.uint32],
    rows: NDArray[np.uint8],
    across: int,
    places: NDArray[np.uint32],  # [tiles] first place of each tile; moved to its end
    ranks: NDArray[np.uint32],  # -> [P] splats, tile after tile
) -> None:
    # As above. Unsigned numbers need no test for Python's negative indices: a third less time.
    for m in range(len(boxes)):
        x0, y0 = int(boxes[m, 0] & 0xFFFF), int(boxes[m, 0] >> 16)
        x1, y1 = int(boxes[m, 1] & 0xFFFF), int(boxes[m, 1] >> 16)
        if rows[m, 0] == WHOLE:
            for y in range(y0, y1):
                for tile in range(np.uintp(y * across + x0), np.uintp(y * across + x1)):
                    place = np.uintp(places[tile])
                    ranks[place] = m
                    places[tile] = place + 1
        else:
            for k in range(y1 - y0):
                row = rows[m, k]
                first = np.uintp((y0 + k) * across + x0 + int(row >> 4))
                for tile in range(first, first + np.uintp(row & 15)):
                    place = np.uintp(places[tile])
                    ranks[place] = m
                    places[tile] = place + 1
