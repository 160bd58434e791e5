"""Loops that blend tiles on a CPU, splat after splat, nearest first.

A splat is small beside its tiles: of 8x8 px it mostly reaches a few rows. So each pair of rows has
a list of its own, of a few splats at a time.
"""

# pyright: reportUntypedFunctionDecorator=false, reportCallIssue=false
import numpy as np
from numba import njit
from numpy.typing import NDArray

from render.splats.projection_kernels import TILE_PX
from render.splats.row_kernels import (
    CHANNELS,
    KEPT,
    ROWS,
    blend_rows,
    fetch,
    lets_through,
    reach_rows,
)
from render.types import U32, Floats

PIXELS = TILE_PX * TILE_PX
PAIRS = TILE_PX // ROWS  # of rows of a tile
AT_ONCE = 8  # splats that are blended before it is asked whether they hide the rest
AHEAD = 8  # splats that are fetched before they are needed
OPAQUE = np.float32(1 / 128)  # a tile that lets less through hides the rest
ZERO, ONE, HALF = np.float32(0), np.float32(1), np.float32(0.5)
TINY, LEVELS = np.float32(1e-6), np.float32(255)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _blend_splats(
    tile: Floats,  # [4 * 64] what it lets through, red, green, blue -> the same with splats behind
    left: np.float32,  # px, middle of its first pixel
    top: np.float32,
    splats: Floats,  # [N, NUMBERS]
    pairs: U32,  # pairs[first] .. pairs[stop - 1] are blended, at most AT_ONCE
    first: np.uintp,
    stop: np.uintp,
    last: np.uintp,  # the last one that may be fetched
    work: Floats,  # [AT_ONCE * KEPT]
    chosen: U32,  # [PAIRS, AT_ONCE + 1]
) -> None:
    a = b = c = d = np.uintp(0)  # how many splats each pair of rows has
    place = np.uintp(0)
    for i in range(first, stop):
        fetch(splats, np.uintp(pairs[min(i + np.uintp(AHEAD), last)]))
        rows = reach_rows(splats, np.uintp(pairs[i]), left, top, work, place)
        chosen[0, a] = chosen[1, b] = chosen[2, c] = chosen[3, d] = place
        a += np.uintp(rows & 3 > 0)
        b += np.uintp(rows & 12 > 0)
        c += np.uintp(rows & 48 > 0)
        d += np.uintp(rows & 192 > 0)
        place += np.uintp(KEPT)
    if a:
        blend_rows(tile, np.uintp(0), work, chosen[0], a)
    if b:
        blend_rows(tile, np.uintp(2), work, chosen[1], b)
    if c:
        blend_rows(tile, np.uintp(4), work, chosen[2], c)
    if d:
        blend_rows(tile, np.uintp(6), work, chosen[3], d)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def blend_tiles(
    tiles: NDArray[np.int64],  # [n] of the picture
    starts: tuple[U32, ...],  # [tiles + 2] of each portion, nearest first, see tile_pairs.Pairs
    pairs: tuple[U32, ...],
    splats: Floats,  # [N, NUMBERS]
    background: Floats,  # [3]
    picture: NDArray[np.int32],  # -> [H, W] bytes of red, green, blue, alpha
) -> None:
    height, width = picture.shape
    across = (width + TILE_PX - 1) // TILE_PX
    tile = np.empty(CHANNELS * PIXELS, np.float32)
    through, red = tile[:PIXELS], tile[PIXELS : 2 * PIXELS]
    green, blue = tile[2 * PIXELS : 3 * PIXELS], tile[3 * PIXELS :]
    words = np.empty(PIXELS, np.int32)
    work, chosen = np.empty(AT_ONCE * KEPT, np.float32), np.empty((PAIRS, AT_ONCE + 1), np.uint32)
    for number in tiles:
        row, column = TILE_PX * (number // across), TILE_PX * (number % across)
        left, top = np.float32(column) + HALF, np.float32(row) + HALF
        tile[:PIXELS], tile[PIXELS:] = ONE, ZERO
        hidden = False
        for portion in range(len(starts)):
            near_to_far, first = pairs[portion], starts[portion]
            i, end = np.uintp(first[number]), np.uintp(first[number + 1]) - np.uintp(1)
            last = end - np.uintp(1)
            while i < end and not hidden:
                stop = min(i + np.uintp(AT_ONCE), end)
                _blend_splats(tile, left, top, splats, near_to_far, i, stop, last, work, chosen)
                i = stop
                hidden = not lets_through(tile, OPAQUE)
        for k in range(PIXELS):
            # Behind a hidden rest it looks like before it, not like the background.
            rest = ZERO if hidden else through[k]
            scale = (ONE - rest) / max(ONE - through[k], TINY) * LEVELS
            behind = rest * LEVELS
            a = np.int32(red[k] * scale + behind * background[0] + HALF)
            b = np.int32(green[k] * scale + behind * background[1] + HALF)
            c = np.int32(blue[k] * scale + behind * background[2] + HALF)
            alpha = np.int32((ONE - rest) * LEVELS + HALF)
            words[k] = a | b << np.int32(8) | c << np.int32(16) | alpha << np.int32(24)
        for y in range(min(TILE_PX, height - row)):
            for x in range(min(TILE_PX, width - column)):
                picture[row + y, column + x] = words[TILE_PX * y + x]
