"""Depths of projected splats -> which of them are drawn, nearest first."""

import numpy as np
from numpy.typing import NDArray

from render.splats import tile_kernels
from render.splats.projection_kernels import HIDDEN


class DepthOrder:
    """Keeps its memory from picture to picture."""

    def __init__(self) -> None:
        self._order = self._work = np.empty(0, np.uint32)

    def of(
        self,
        depths: NDArray[np.float32],  # [N] mm; HIDDEN or BROKEN: not drawn
    ) -> NDArray[np.uint32]:  # [M] valid until the next call
        """Indices of the drawn ones; equal depths keep their order."""
        if len(depths) != len(self._order):
            self._order, self._work = (np.empty(len(depths), np.uint32) for _ in range(2))
        bits = depths.view(np.uint32)
        count = tile_kernels.nearest_first(bits, HIDDEN.view(np.uint32), self._order, self._work)
        return self._order[:count]
