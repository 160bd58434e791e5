"""Loops of the tile renderer, compiled by numba as those of `decoder/kernels/surface.py` are."""

# pyright: reportUntypedFunctionDecorator=false
import numpy as np
from numba import njit
from numpy.typing import NDArray

WHOLE = np.uint8(255)  # byte of a row: the splat reaches every tile of its box


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
    boxes: NDArray[np.uint32],  # [N, 2] tiles: x0 | y0 << 16, x1 | y1 << 16
    rows: NDArray[np.uint8],  # [N, 8] left out << 4 | reached, or WHOLE
    order: NDArray[np.uint32],  # [M] of the splats that are dealt
    across: int,
    counts: NDArray[np.int32],  # -> [tiles + 1] splats that reach each tile; the last is 0
) -> None:
    counts[:] = 0  # first the change from each tile to the next
    for m in range(len(order)):
        i = np.uintp(order[m])
        x0, y0 = int(boxes[i, 0] & 0xFFFF), int(boxes[i, 0] >> 16)
        x1, y1 = int(boxes[i, 1] & 0xFFFF), int(boxes[i, 1] >> 16)
        whole = rows[i, 0] == WHOLE
        for k in range(y1 - y0):
            first, last = np.uintp((y0 + k) * across + x0), np.uintp((y0 + k) * across + x1)
            if not whole:
                first += np.uintp(rows[i, k] >> 4)
                last = first + np.uintp(rows[i, k] & 15)
            counts[first] += 1
            counts[last] -= 1
    for tile in range(1, len(counts)):
        counts[tile] += counts[tile - 1]


@njit(cache=True, nogil=True)
def fill_tiles(
    boxes: NDArray[np.uint32],
    rows: NDArray[np.uint8],
    order: NDArray[np.uint32],  # [M] of the splats, nearest first
    across: int,
    places: NDArray[np.uint32],  # [tiles] first place of each tile; moved to its end
    splats: NDArray[np.uint32],  # -> [P] tile after tile
) -> None:
    # Unsigned numbers need no test for Python's negative indices: a third less time.
    for m in range(len(order)):
        splat = order[m]
        i = np.uintp(splat)
        x0, y0 = int(boxes[i, 0] & 0xFFFF), int(boxes[i, 0] >> 16)
        x1, y1 = int(boxes[i, 1] & 0xFFFF), int(boxes[i, 1] >> 16)
        if rows[i, 0] == WHOLE:
            for y in range(y0, y1):
                for tile in range(np.uintp(y * across + x0), np.uintp(y * across + x1)):
                    place = np.uintp(places[tile])
                    splats[place] = splat
                    places[tile] = place + 1
        else:
            for k in range(y1 - y0):
                row = rows[i, k]
                first = np.uintp((y0 + k) * across + x0 + int(row >> 4))
                for tile in range(first, first + np.uintp(row & 15)):
                    place = np.uintp(places[tile])
                    splats[place] = splat
                    places[tile] = place + 1
