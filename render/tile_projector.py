"""Gaussians -> splats on the screen and the tiles that they reach, on the CPU."""

import numpy as np

from render import projection_kernels as kernels
from render.depth_order import DepthOrder
from render.projection_kernels import MAX_ALPHA, TILE_PX, U32, Floats
from render.reference import FRUSTUM_MARGIN
from render.types import FIELDS, Camera, Gaussians

TRANSPARENT = np.float32(1e-6)


class TileProjector:
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
        means, quats, scales, opacities, colors = (
            np.ascontiguousarray(getattr(gaussians, name), np.float32).reshape(-1)
            for name in FIELDS
        )
        view, lens = np.asarray(camera.viewmat, np.float32).reshape(-1), lens_of(camera)
        log2_opacity = np.log2(np.clip(opacities, TRANSPARENT, MAX_ALPHA))
        x, y, slope_x, slope_y, var_x, var_y, cov, p, q, r, half_y = self._work
        boxes, depths = self.boxes.reshape(-1), self._depths
        across, down = (np.float32(-(-px // TILE_PX)) for px in (camera.width, camera.height))

        kernels.place(means, view, lens, x, y, depths, slope_x, slope_y)
        kernels.flatten(
            *(quats, scales, view, lens, depths, slope_x, slope_y), *(var_x, var_y, cov)
        )
        kernels.invert(var_x, var_y, cov, p, q, r)
        kernels.enclose(x, y, var_x, var_y, log2_opacity, across, down, half_y, boxes)
        kernels.reach(x, y, p, q, r, log2_opacity, half_y, boxes, self._first_rows, self._rows)
        bits_p, bits_q, bits_r = (factor.view(np.int32) for factor in (p, q, r))
        splats = self.splats.reshape(-1)
        kernels.pack(x, y, bits_p, bits_q, bits_r, log2_opacity, colors, splats)
        near = np.float32(camera.near_mm)
        kernels.judge(means, quats, scales, opacities, colors, boxes, near, depths)
        return self._order.of(depths)

    def _reserve(self, count: int) -> None:
        self.splats = np.zeros((count, 4), np.uint32)  # packed, see shaders/splat.glsl
        self.boxes = np.zeros((count, 2), np.uint32)  # tiles: x0 | y0 << 16, x1 | y1 << 16
        self._rows = np.zeros(count, np.uint64)
        self.rows = self._rows.view(np.uint8).reshape(-1, 8)  # left out << 4 | reached, or WHOLE
        self._depths = np.zeros(count, np.float32)  # mm, HIDDEN or BROKEN
        self._work = np.zeros((11, count), np.float32)
        self._first_rows = np.zeros(count, np.uint32)


def lens_of(camera: Camera) -> Floats:  # [8]
    """Focal lengths and centre (px), and the slopes between which the Jacobian is taken."""
    K, size = camera.K, np.array([camera.width, camera.height], np.float64)
    focal, centre = np.array([K[0, 0], K[1, 1]]), np.array([K[0, 2], K[1, 2]])
    margin = FRUSTUM_MARGIN * 0.5 * size
    low, high = -(centre + margin) / focal, (size - centre + margin) / focal
    return np.array([*focal, *centre, low[0], high[0], low[1], high[1]], np.float32)
