"""(tile, splat) pairs, sorted by tile and then by depth.

Boxes of tiles [M, 2] are two corners: x0 | y0 << 16 and, excluded, x1 | y1 << 16; splats come
nearest first. A pair is a key, tile << bits | rank in depth.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from render.errors import InputError

MAX_PAIRS = 1 << 25  # of a picture; 128 MiB
LOW_16, SHIFT_16 = np.uint32(0xFFFF), np.uint32(16)
WHOLE = 255  # byte of a row: the splat reaches every tile of its box
U32 = NDArray[np.uint32]


class Pairs(NamedTuple):
    """Tile i has the splats ranks[starts[i]:starts[i + 1]] & mask, nearest first."""

    ranks: U32  # [P]
    starts: U32  # [tiles + 1]
    mask: int


def sort_by_tile(
    boxes: U32,  # [M, 2]
    size: tuple[int, int],  # tiles across, down
    rows: NDArray[np.uint8] | None = None,  # [M, 8] left out << 4 | reached, or WHOLE
) -> Pairs:
    """All pairs of splats and the tiles of their boxes, or of the rows that they reach."""
    num_tiles = size[0] * size[1]
    bits = max(1, int(len(boxes) - 1).bit_length())
    narrow = bits + num_tiles.bit_length() <= 32
    dtype = np.uint32 if narrow else np.uint64
    step_x, step_y = dtype(1 << bits), dtype(size[0] << bits)
    x0, y0 = (boxes[:, 0] & LOW_16).astype(dtype), (boxes[:, 0] >> SHIFT_16).astype(dtype)
    first = y0 * step_y + x0 * step_x + np.arange(len(boxes), dtype=dtype)
    if rows is None:
        keys = _fill(first, boxes, step_x, step_y)
    else:
        whole = np.flatnonzero(rows[:, 0] == WHOLE)
        rows[whole] = 0
        spans = np.flatnonzero(rows != 0)
        owner, row = spans >> 3, (spans & 7).astype(dtype)
        span = rows.ravel().take(spans)
        starts = first.take(owner) + row * step_y + (span >> 4) * step_x
        keys = expand(starts, span & 15, step_x)
        if len(whole):
            keys = np.append(keys, _fill(first[whole], boxes[whole], step_x, step_y))
    keys.sort()
    starts = np.searchsorted(keys, np.arange(num_tiles + 1, dtype=dtype) << dtype(bits))
    return Pairs(keys.astype(np.uint32, copy=False), starts.astype(np.uint32), (1 << bits) - 1)


def _fill(first: NDArray, boxes: U32, step_x: np.generic, step_y: np.generic) -> NDArray:
    """A key for every tile of every box."""
    width = (boxes[:, 1] & LOW_16) - (boxes[:, 0] & LOW_16)
    height = (boxes[:, 1] >> SHIFT_16) - (boxes[:, 0] >> SHIFT_16)
    total = int(np.dot(width.astype(np.int64), height.astype(np.int64)))
    if total > MAX_PAIRS:
        raise InputError(
            f"splats: expected at most {MAX_PAIRS} (splat, tile) pairs, got {total}; "
            "draw fewer or smaller Gaussians, or move the camera away"
        )
    return expand(expand(first, height, step_y), np.repeat(width, height), step_x)


def expand(keys: NDArray, counts: NDArray, step: np.generic) -> NDArray:
    """Replace keys[i] by keys[i] + step * (0, 1, .. counts[i] - 1); every count is above 0.

    A running sum of steps and jumps, which may wrap below zero and back: four times as fast as
    repeating.
    """
    if len(keys) == 0:
        return keys
    ends = np.cumsum(counts, dtype=np.int64)
    out = np.full(ends[-1], step, keys.dtype)
    last = keys + (counts.astype(keys.dtype) - keys.dtype.type(1)) * step
    out[0] = keys[0]
    out[ends[:-1]] = keys[1:] - last[:-1]
    return np.cumsum(out, dtype=keys.dtype, out=out)
