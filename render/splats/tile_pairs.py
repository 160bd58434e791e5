"""(tile, splat) pairs: which splats each tile blends, nearest first."""

from typing import NamedTuple

import numpy as np

from render.splats import tile_kernels
from render.splats.reach_kernels import WHOLE
from render.types import U32, U64
from sensors.types import InputError

MAX_PAIRS = 1 << 25  # of a picture; 128 MiB


class Reaches(NamedTuple):
    """The tiles that splats reach, see `reach_kernels.py`."""

    words: U64  # [N]
    further: U32  # [N] the next four rows of those that say so


class Pairs(NamedTuple):
    """Tile i has the splats splats[starts[i] : starts[i + 1] - 1], nearest first.

    Lists are one place apart, which loops write that do not ask whether they should. Behind the
    last tile there is one more, whose list is empty.
    """

    starts: U32  # [tiles + 2]
    splats: U32  # [P + tiles + 2]

    @property
    def counts(self) -> U32:
        """How many splats each tile has [tiles]."""
        return np.diff(self.starts)[:-1] - np.uint32(1)


def bin_splats(
    boxes: U32,  # [N, 2] tiles of every splat: x0 | y0 << 16 and, excluded, x1 | y1 << 16
    order: U32,  # [M] the splats that are seen, nearest first
    size: tuple[int, int],  # tiles across, down
    reaches: Reaches | None = None,
    most: int = MAX_PAIRS,
) -> Pairs:
    """Pairs of splats and the tiles of their boxes or, where that is told, those they reach.

    Splats are dealt to their tiles in the order of depth, so nothing has to be sorted.
    """
    across, tiles = size[0], size[0] * size[1]
    if reaches is None:
        reaches = Reaches(np.full(len(boxes), WHOLE), np.empty(0, np.uint32))
    starts, seen = np.empty(tiles + 2, np.uint32), np.empty(len(order), np.uint64)
    total = tile_kernels.count_tiles(*reaches, boxes, order, across, seen, starts)
    if total > most:
        raise InputError(
            f"splats: expected at most {most} (splat, tile) pairs, got {total}; "
            "draw fewer or smaller Gaussians, or move the camera away"
        )
    splats = np.empty(starts[-1] + 1, np.uint32)
    tile_kernels.fill_tiles(seen, reaches.further, boxes, order, across, starts, splats)
    return Pairs(starts, splats)
