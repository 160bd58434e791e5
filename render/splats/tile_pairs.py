"""(tile, splat) pairs: which splats each tile blends, nearest first."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from render.splats import tile_kernels
from render.types import U32
from sensors.types import InputError

MAX_PAIRS = 1 << 25  # of a picture; 128 MiB


class Pairs(NamedTuple):
    """Tile i has the splats splats[starts[i]:starts[i + 1]], nearest first."""

    splats: U32  # [P]
    starts: U32  # [tiles + 1]


def bin_splats(
    boxes: U32,  # [N, 2] tiles of every splat: x0 | y0 << 16 and, excluded, x1 | y1 << 16
    order: U32,  # [M] the splats that are seen, nearest first
    size: tuple[int, int],  # tiles across, down
    rows: NDArray[np.uint8] | None = None,  # [N, 8] left out << 4 | reached, or WHOLE
) -> Pairs:
    """Pairs of splats and the tiles of their boxes or, where `rows` are told, of what they reach.

    Splats are dealt to their tiles in the order of depth, so nothing has to be sorted.
    """
    if rows is None:
        rows = np.full((len(boxes), 8), tile_kernels.WHOLE)
    counts = np.empty(size[0] * size[1] + 1, np.int32)
    tile_kernels.count_tiles(boxes, rows, order, size[0], counts)
    total = int(counts.sum(dtype=np.int64))
    if total > MAX_PAIRS:
        raise InputError(
            f"splats: expected at most {MAX_PAIRS} (splat, tile) pairs, got {total}; "
            "draw fewer or smaller Gaussians, or move the camera away"
        )
    starts = np.zeros(len(counts), np.uint32)
    np.cumsum(counts[:-1], out=starts[1:])
    splats = np.empty(total, np.uint32)
    tile_kernels.fill_tiles(boxes, rows, order, size[0], starts[:-1].copy(), splats)
    return Pairs(splats, starts)
