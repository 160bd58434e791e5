"""Loops of the tile renderer, compiled by numba as those of `decoder/kernels/surface.py` are."""

# pyright: reportUntypedFunctionDecorator=false
import numpy as np
from numba import njit
from numpy.typing import NDArray

from render.splats.reach_kernels import FURTHER, ROWS, WHOLE
from render.types import U32, U64

BELOW = ROWS - 1  # rows of tiles below the picture that a count may touch
TILE_BITS, FIRST_TILE = np.uint64(32), np.uint64((1 << 30) - 1)
Word = int | np.unsignedinteger | np.bool_
# Unsigned numbers need no test for Python's negative indices: a third less time.
ZERO, ONE, TWO, THREE = np.uintp(0), np.uintp(1), np.uintp(2), np.uintp(3)
DIGIT, LOW = 12, np.uint32((1 << 12) - 1)
LEFT_BITS, FIFTEEN, FOUR_ROWS = np.uint64(4), np.uint64(15), np.uint64((1 << 32) - 1)


@njit(cache=True, nogil=True)
def nearest_first(
    bits: NDArray[np.uint32],  # [N] of depths, which sort like the floats they are: all positive
    hidden: np.uint32,  # those from here on are left out
    order: NDArray[np.uint32],  # -> [N] indices, nearest first, equal ones as they come
    work: NDArray[np.uint32],  # [N]
) -> int:  # how many
    """A radix sort of two times 12 bits, of how far each is behind the nearest.

    Depths of a head differ in no more; of other clouds, what is left out is far below a millimetre.
    """
    nearest, farthest = hidden, np.uint32(0)
    for i in range(len(bits)):
        seen = bits[i] < hidden
        nearest = min(nearest, bits[i])
        farthest = max(farthest, bits[i] if seen else np.uint32(0))
    if nearest == hidden:
        return 0
    shift = np.uint32(0)
    while (farthest - nearest) >> shift >= np.uint32(1) << np.uint32(2 * DIGIT):
        shift += np.uint32(1)
    counts = np.zeros((2, (1 << DIGIT) + 1), np.uint32)
    for i in range(len(bits)):
        if bits[i] < hidden:
            key = (bits[i] - nearest) >> shift
            counts[0, np.uintp(key & LOW) + ONE] += 1
            counts[1, np.uintp(key >> np.uint32(DIGIT)) + ONE] += 1
    places = np.cumsum(counts[0]).astype(np.uint32)
    for i in range(len(bits)):
        if bits[i] < hidden:
            digit = np.uintp((bits[i] - nearest) >> shift & LOW)
            work[places[digit]] = i
            places[digit] += np.uint32(1)
    total = int(places[(1 << DIGIT) - 1])
    places = np.cumsum(counts[1]).astype(np.uint32)
    for n in range(total):
        i = work[n]
        digit = np.uintp((bits[np.uintp(i)] - nearest) >> shift >> np.uint32(DIGIT))
        order[places[digit]] = i
        places[digit] += np.uint32(1)
    return total


@njit(cache=True, nogil=True)
def count_tiles(
    reaches: U64,  # [N] see reach_kernels.py
    further: U32,  # [N]
    boxes: U32,  # [N, 2] tiles: x0 | y0 << 16, x1 | y1 << 16
    order: U32,  # [M] of the splats that are dealt
    across: int,
    seen: U64,  # -> [M] reaches in this order: `fill_tiles` must not wait for them
    starts: U32,  # -> [tiles + 2] see tile_pairs.Pairs
) -> int:  # how many splats all tiles have
    counts = np.zeros(len(starts) - 1 + BELOW * across, np.int32)
    # first the change from each tile to the next
    for m in range(len(order)):
        i = np.uintp(order[m])
        reach = seen[m] = reaches[i]
        tile = np.uintp(reach >> TILE_BITS & FIRST_TILE)
        _count_rows(reach, tile, across, counts)
        if reach >= FURTHER:
            _count_rows(np.uint64(further[i]), tile + np.uintp(ROWS * across), across, counts)
        elif reach == WHOLE:
            x0, y0 = np.uintp(boxes[i, 0] & 0xFFFF), np.uintp(boxes[i, 0] >> 16)
            x1, y1 = np.uintp(boxes[i, 1] & 0xFFFF), np.uintp(boxes[i, 1] >> 16)
            for y in range(y0, y1):
                counts[y * np.uintp(across) + x0] += 1
                counts[y * np.uintp(across) + x1] -= 1
    total, count, starts[0] = 0, 0, 0
    for tile in range(len(starts) - 1):
        count += counts[tile]
        total += count
        starts[tile + 1] = total + tile + 1
    return total


@njit(cache=True, nogil=True)
def _count_rows(reach: Word, tile: Word, across: int, counts: NDArray[np.int32]) -> None:
    """All four rows, without a question: what reaches nothing adds 1 and takes it away again."""
    for row in range(ROWS):
        byte = reach >> np.uint64(8 * row)
        first = tile + np.uintp(row * across) + np.uintp(byte >> LEFT_BITS & FIFTEEN)
        counts[first] += 1
        counts[first + np.uintp(byte & FIFTEEN)] -= 1


@njit(cache=True, nogil=True)
def fill_tiles(
    seen: U64,  # [M]
    further: U32,
    boxes: U32,
    order: U32,  # [M] of the splats, nearest first
    across: int,
    starts: U32,  # [tiles + 2] first place of each tile
    splats: U32,  # -> [P + tiles + 2] tile after tile, one place apart
) -> None:
    places = starts.copy()
    for m in range(len(order)):
        splat, reach = order[m], seen[m]
        tile = np.uintp(reach >> TILE_BITS & FIRST_TILE)
        _fill_rows(splat, reach & FOUR_ROWS, tile, across, places, splats)
        if reach >= FURTHER:
            rows, below = np.uint64(further[np.uintp(splat)]), tile + np.uintp(ROWS * across)
            _fill_rows(splat, rows, below, across, places, splats)
        elif reach == WHOLE:
            i = np.uintp(splat)
            x0, y0 = np.uintp(boxes[i, 0] & 0xFFFF), np.uintp(boxes[i, 0] >> 16)
            x1, y1 = np.uintp(boxes[i, 1] & 0xFFFF), np.uintp(boxes[i, 1] >> 16)
            for y in range(y0, y1):
                for at in range(y * np.uintp(across) + x0, y * np.uintp(across) + x1):
                    _put(splat, at, True, places, splats)


@njit(cache=True, nogil=True)
def _fill_rows(splat: Word, rows: Word, tile: Word, across: int, places: U32, splats: U32) -> None:
    """Nearly all rows reach one to three tiles: three are written, whether they are reached or not.

    A processor guesses wrong too often where it has to branch for each.
    """
    while rows:
        first, reached = tile + np.uintp(rows >> LEFT_BITS & FIFTEEN), np.uintp(rows & FIFTEEN)
        _put(splat, first, reached > ZERO, places, splats)
        _put(splat, first + ONE, reached > ONE, places, splats)
        _put(splat, first + TWO, reached > TWO, places, splats)
        for at in range(first + THREE, first + reached):
            _put(splat, at, True, places, splats)
        rows >>= np.uint64(8)
        tile += np.uintp(across)


@njit(cache=True, nogil=True)
def _put(splat: Word, tile: Word, stays: Word, places: U32, splats: U32) -> None:
    """At the next place of a tile; what does not stay is overwritten, or behind its list."""
    place = np.uintp(places[tile])
    splats[place] = splat
    places[tile] = place + np.uintp(stays)


@njit(cache=True, nogil=True)
def blended_tiles(
    starts: tuple[U32, ...],  # [tiles + 2] of each portion
    covered: NDArray[np.bool_],  # [tiles] that showed splats in the last picture -> in this one
) -> NDArray[np.int64]:
    """Tiles of which a picture has to be made: what was covered has to be cleared."""
    chosen, count = np.empty(len(covered), np.int64), 0
    for tile in range(len(covered)):
        has = False
        for portion in range(len(starts)):
            has |= starts[portion][tile + 1] - starts[portion][tile] > 1
        chosen[count] = tile
        count += has | covered[tile]
        covered[tile] = has
    return chosen[:count]
