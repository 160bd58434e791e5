"""Gaussians -> packed splats in depth order, and the tiles they reach: the first half of a draw."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from render.splats import projection_kernels as kernels
from render.splats import reach_kernels
from render.splats.depth_order import DepthOrder
from render.splats.projection_kernels import MAX_ALPHA, TILE_PX
from render.splats.reference import FRUSTUM_MARGIN
from render.splats.shine import colors_from
from render.types import FIELDS, U32, Camera, Floats, Gaussians

TRANSPARENT = np.float32(1e-6)


class Projector:
    """Holds the splats of the last run; rows of undrawn ones are leftovers."""

    def __init__(self) -> None:
        self._reserve(0)
        self._order = DepthOrder()

    @property
    def dropped(self) -> int:
        """Gaussians of the last run that no picture can show."""
        return self._order.dropped

    def run(self, gaussians: Gaussians, camera: Camera) -> U32:
        """Project; returns the indices [M] of the visible splats, nearest first."""
        gaussians.check()
        if len(gaussians) != len(self.splats):
            self._reserve(len(gaussians))
        seen = replace(gaussians, colors=colors_from(gaussians, camera.position), shine=None)
        means, quats, scales, opacities, colors = (
            np.ascontiguousarray(getattr(seen, name), np.float32).reshape(-1) for name in FIELDS
        )
        view, lens = np.asarray(camera.viewmat, np.float32).reshape(-1), lens_of(camera)
        x, y, slope_x, slope_y, var_x, var_y, cov, p, q, r, half_y, faded = self._work
        boxes, depths = self.boxes.reshape(-1), self._depths
        across, down = (np.float32(-(-px // TILE_PX)) for px in (camera.width, camera.height))

        kernels.project_means(means, view, lens, x, y, depths, slope_x, slope_y)
        kernels.fade(opacities, scales, lens[0], depths, faded)
        log2_opacity = np.log2(np.clip(faded, TRANSPARENT, MAX_ALPHA))
        kernels.project_covariances(
            *(quats, scales, view, lens, depths, slope_x, slope_y), *(var_x, var_y, cov)
        )
        kernels.invert(var_x, var_y, cov, p, q, r)
        kernels.bound(x, y, var_x, var_y, log2_opacity, across, down, half_y, boxes)
        bits_p, bits_q, bits_r = (factor.view(np.int32) for factor in (p, q, r))
        splats = self.splats.reshape(-1)
        kernels.pack(x, y, bits_p, bits_q, bits_r, log2_opacity, colors, splats)
        self._log2_opacity, near = log2_opacity, np.float32(camera.near_mm)
        kernels.cull(means, quats, scales, opacities, faded, colors, boxes, near, depths)
        return self._order.of(depths)

    def reached_tiles(self) -> NDArray[np.uint8]:  # [N, 8]
        """Of the last run, by rows of a splat's box: tiles left out << 4 | reached, or WHOLE."""
        x, y, _, _, _, _, _, p, q, r, half_y, _ = self._work
        reach_kernels.reached_tiles(
            *(x, y, p, q, r, self._log2_opacity, half_y),
            *(self.boxes.reshape(-1), self._first_rows, self._rows),
        )
        return self._rows.view(np.uint8).reshape(-1, 8)

    def _reserve(self, count: int) -> None:
        self.splats = np.zeros((count, 4), np.uint32)  # packed, see shaders/splat.glsl
        self.boxes = np.zeros((count, 2), np.uint32)  # tiles: x0 | y0 << 16, x1 | y1 << 16
        self._rows = np.zeros(count, np.uint64)
        self._depths = np.zeros(count, np.float32)  # mm, HIDDEN or BROKEN
        self._work = np.zeros((12, count), np.float32)
        self._first_rows = np.zeros(count, np.uint32)
        self._log2_opacity = np.zeros(count, np.float32)


def lens_of(camera: Camera) -> Floats:  # [8]
    """Focal lengths and centre (px), and the slopes between which the Jacobian is taken."""
    K, size = camera.K, np.array([camera.width, camera.height], np.float64)
    focal, centre = np.array([K[0, 0], K[1, 1]]), np.array([K[0, 2], K[1, 2]])
    margin = FRUSTUM_MARGIN * 0.5 * size
    low, high = -(centre + margin) / focal, (size - centre + margin) / focal
    return np.array([*focal, *centre, low[0], high[0], low[1], high[1]], np.float32)
