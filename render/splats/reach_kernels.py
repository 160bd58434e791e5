"""Which tiles the ellipse of a splat reaches: most boxes around an ellipse have empty corners."""

# pyright: reportUntypedFunctionDecorator=false
import numpy as np
from numba import njit

from render.splats.projection_kernels import FAINTEST, FAST, HALF, ONE, TILES_A_PX, ZERO
from render.types import U32, U64, Floats

# A reach: four rows of the box, a byte each (tiles left out << 4 | reached) | its first tile << 32,
# and one of these where four rows are not enough.
WHOLE = np.uint64(1 << 62)  # every tile of the box is reached; nothing else is said
FURTHER = np.uint64(1 << 63)  # four more rows are kept beside it
ROWS, MOST_ACROSS, MOST_DOWN = 4, 15, 8  # tiles of a box with rows
SLACK = np.float32(0.02)  # px
SIXTEEN = np.float32(16)
TILE, TO_LAST_ROW = np.float32(8), np.float32(7)


@njit(**FAST)
def reached_rows(
    x: Floats,  # [N]
    y: Floats,
    p: Floats,
    q: Floats,
    r: Floats,
    log2_opacity: Floats,
    half_y: Floats,
    boxes: U32,  # [N * 2]
    first_row: np.float32,  # of the box
    rows: U32,  # -> [N] a byte for each of four rows: left out << 4 | reached
) -> None:
    """Which tiles of four rows of its box each ellipse reaches."""
    for i in range(len(x)):
        x0, y0 = np.float32(boxes[2 * i] & 0xFFFF), np.float32(boxes[2 * i] >> 16)
        x1, y1 = np.float32(boxes[2 * i + 1] & 0xFFFF), np.float32(boxes[2 * i + 1] >> 16)
        h = half_y[i]
        widest = q[i] * h / np.sqrt(q[i] * q[i] + r[i] * r[i])  # how far down it is leftmost
        width, spread = ONE / p[i], max(log2_opacity[i] + FAINTEST, ZERO)
        word = np.uint32(0)
        for row in range(ROWS):
            at = y0 + first_row + np.float32(row)
            bits = _row(at, x0, x1, y1, x[i], y[i], q[i], r[i], h, widest, width, spread)
            word |= np.uint32(bits) << np.uint32(8 * row)
        rows[i] = word


@njit(**FAST)
def join_reaches(
    boxes: U32,  # [N * 2]
    rows: U32,  # [N] the first four
    across: int,  # tiles of a picture
    reaches: U64,  # -> [N]
) -> None:
    for i in range(len(rows)):
        x0, y0 = np.int64(boxes[2 * i] & 0xFFFF), np.int64(boxes[2 * i] >> 16)
        x1, y1 = np.int64(boxes[2 * i + 1] & 0xFFFF), np.int64(boxes[2 * i + 1] >> 16)
        reach = np.uint64((y0 * across + x0) << 32) | np.uint64(rows[i])
        reach |= FURTHER if y1 - y0 > ROWS else np.uint64(0)
        large = (x1 - x0 > MOST_ACROSS) | (y1 - y0 > MOST_DOWN)
        reaches[i] = WHOLE if large else reach


@njit(**FAST)
def _row(at, x0, x1, y1, x, y, q, r, h, widest, width, spread):  # noqa: ANN001, ANN202
    """Left out << 4 | reached, of the row of tiles `at`; 0 below the box."""
    top = at * TILE + HALF - SLACK - y
    end = top + TO_LAST_ROW + SLACK + SLACK
    hit = (top <= h) & (end >= -h) & (at < y1)
    top, end = max(top, -h), min(end, h)
    low, high = min(max(widest, top), end), min(max(-widest, top), end)
    v, w = r * low, r * high
    left = x - (np.sqrt(max(spread - v * v, ZERO)) + q * low) * width
    right = x + (np.sqrt(max(spread - w * w, ZERO)) - q * high) * width
    first, last = np.ceil(left - SLACK - HALF), np.floor(right + SLACK + HALF)  # px
    hit &= first < last
    first, last = max(np.floor(first * TILES_A_PX), x0), min(np.ceil(last * TILES_A_PX), x1)
    hit &= first < last
    return np.int32((first - x0) * SIXTEEN + (last - first) if hit else ZERO)
