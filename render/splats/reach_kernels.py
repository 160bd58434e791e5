"""Which tiles the ellipse of a splat reaches: most boxes around an ellipse have empty corners."""

# pyright: reportUntypedFunctionDecorator=false
import numpy as np
from numba import njit
from numpy.typing import NDArray

from render.splats.projection_kernels import FAINTEST, FAST, HALF, ONE, TILES_A_PX, ZERO
from render.types import U32, Floats

MOST_ACROSS, MOST_DOWN = 15, 8  # tiles of a box with rows
SLACK = np.float32(0.02)  # px
SIXTEEN = np.float32(16)
TILE, TO_LAST_ROW = np.float32(8), np.float32(7)
ALL = np.uint64(0xFFFFFFFFFFFFFFFF)


@njit(**FAST)
def reached_tiles(
    x: Floats,  # [N]
    y: Floats,
    p: Floats,
    q: Floats,
    r: Floats,
    log2_opacity: Floats,
    half_y: Floats,
    boxes: U32,
    first_rows: U32,  # -> [N] the same of four rows: nearly all splats have no more
    rows: NDArray[np.uint64],  # -> [N] a byte for each row of the box: left out << 4 | reached
) -> None:
    """Which tiles of each row the ellipse reaches; all bits are set where the box is too large."""
    for i in range(len(x)):
        x0, y0 = np.float32(boxes[2 * i] & 0xFFFF), np.float32(boxes[2 * i] >> 16)
        x1, y1 = np.float32(boxes[2 * i + 1] & 0xFFFF), np.float32(boxes[2 * i + 1] >> 16)
        h = half_y[i]
        widest = q[i] * h / np.sqrt(q[i] * q[i] + r[i] * r[i])  # how far down it is leftmost
        width, spread = ONE / p[i], max(log2_opacity[i] + FAINTEST, ZERO)
        word = np.uint32(0)
        for row in range(4):
            at = y0 + np.float32(row)
            bits = _row(at, x0, x1, y1, x[i], y[i], q[i], r[i], h, widest, width, spread)
            word |= np.uint32(bits) << np.uint32(8 * row)
        first_rows[i] = word
    for i in range(len(x)):
        x0, y0 = np.float32(boxes[2 * i] & 0xFFFF), np.float32(boxes[2 * i] >> 16)
        x1, y1 = np.float32(boxes[2 * i + 1] & 0xFFFF), np.float32(boxes[2 * i + 1] >> 16)
        rows[i] = first_rows[i]
        if x1 - x0 > MOST_ACROSS or y1 - y0 > MOST_DOWN:
            rows[i] = ALL
        elif y1 - y0 > 4:
            h = half_y[i]
            widest = q[i] * h / np.sqrt(q[i] * q[i] + r[i] * r[i])
            width, spread = ONE / p[i], max(log2_opacity[i] + FAINTEST, ZERO)
            for row in range(4, MOST_DOWN):
                at = y0 + np.float32(row)
                bits = _row(at, x0, x1, y1, x[i], y[i], q[i], r[i], h, widest, width, spread)
                rows[i] |= np.uint64(bits) << np.uint64(8 * row)


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
