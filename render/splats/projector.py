"""Gaussians -> splats in depth order, and the tiles they reach: the first half of a draw."""

from dataclasses import replace

import numpy as np

from render.splats import projection_kernels as kernels
from render.splats import reach_kernels
from render.splats.depth_order import DepthOrder
from render.splats.projection_kernels import MAX_ALPHA, TILE_PX
from render.splats.reference import FRUSTUM_MARGIN
from render.splats.shine import colors_from
from render.splats.tile_pairs import Reaches
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
        if len(gaussians) != len(self.boxes):
            self._reserve(len(gaussians))
        seen = replace(gaussians, colors=colors_from(gaussians, camera.position), shine=None)
        means, quats, scales, opacities, colors = (
            np.ascontiguousarray(getattr(seen, name), np.float32).reshape(-1) for name in FIELDS
        )
        view, lens = np.asarray(camera.viewmat, np.float32).reshape(-1), lens_of(camera)
        x, y, p, q, r, log2_opacity, half_y = self._ellipses
        slope_x, slope_y, var_x, var_y, cov, faded = self._work
        boxes, depths = self.boxes.reshape(-1), self._depths
        across, down = (np.float32(-(-px // TILE_PX)) for px in (camera.width, camera.height))

        kernels.project_means(means, view, lens, x, y, depths, slope_x, slope_y)
        kernels.fade(opacities, scales, lens[0], depths, faded)
        np.log2(np.clip(faded, TRANSPARENT, MAX_ALPHA), out=log2_opacity)
        kernels.project_covariances(
            *(quats, scales, view, lens, depths, slope_x, slope_y), *(var_x, var_y, cov)
        )
        kernels.invert(var_x, var_y, cov, p, q, r)
        kernels.bound(x, y, var_x, var_y, log2_opacity, across, down, half_y, boxes)
        self._across, near = int(across), np.float32(camera.near_mm)
        kernels.cull(means, quats, scales, opacities, faded, colors, boxes, near, depths)
        self._colors = colors
        return self._order.of(depths)

    def packed(self) -> U32:  # [N, 4]
        """The splats of the last run for a GPU, see shaders/splat.glsl."""
        x, y, p, q, r, log2_opacity, _ = self._ellipses
        bits_p, bits_q, bits_r = (factor.view(np.int32) for factor in (p, q, r))
        out = np.empty((len(x), 4), np.uint32)
        kernels.pack(x, y, bits_p, bits_q, bits_r, log2_opacity, self._colors, out.reshape(-1))
        return out

    def rows(self, out: Floats) -> None:  # -> [N, 9 and more]
        """The splats of the last run for a CPU, see kernels.interleave."""
        kernels.interleave(self._ellipses[:6].reshape(-1), self._colors, out)

    def reached_tiles(self) -> Reaches:
        """The tiles that the splats of the last run reach."""
        boxes = self.boxes.reshape(-1)
        _reach(self._ellipses, boxes, 0, self._rows)
        reach_kernels.join_reaches(boxes, self._rows, self._across, self._reaches)
        tall = np.flatnonzero(self._reaches >= reach_kernels.FURTHER)  # a few in a hundred
        further = np.empty(len(tall), np.uint32)
        boxes = self.boxes.take(tall, 0).reshape(-1)
        _reach(self._ellipses.take(tall, 1), boxes, reach_kernels.ROWS, further)
        self._further[tall] = further
        return Reaches(self._reaches, self._further)

    def _reserve(self, count: int) -> None:
        self.boxes = np.zeros((count, 2), np.uint32)  # tiles: x0 | y0 << 16, x1 | y1 << 16
        self._ellipses = np.zeros((7, count), np.float32)
        self._work = np.zeros((6, count), np.float32)
        self._colors = np.zeros(3 * count, np.float32)  # as seen from the camera
        self._depths = np.zeros(count, np.float32)  # mm, HIDDEN or BROKEN
        self._reaches = np.zeros(count, np.uint64)
        self._rows, self._further = np.zeros((2, count), np.uint32)
        self._across = 0  # tiles of the last picture


def _reach(ellipses: Floats, boxes: U32, first_row: int, rows: U32) -> None:
    x, y, p, q, r, log2_opacity, half_y = ellipses
    first = np.float32(first_row)
    reach_kernels.reached_rows(x, y, p, q, r, log2_opacity, half_y, boxes, first, rows)


def lens_of(camera: Camera) -> Floats:  # [8]
    """Focal lengths and centre (px), and the slopes between which the Jacobian is taken."""
    K, size = camera.K, np.array([camera.width, camera.height], np.float64)
    focal, centre = np.array([K[0, 0], K[1, 1]]), np.array([K[0, 2], K[1, 2]])
    margin = FRUSTUM_MARGIN * 0.5 * size
    low, high = -(centre + margin) / focal, (size - centre + margin) / focal
    return np.array([*focal, *centre, low[0], high[0], low[1], high[1]], np.float32)
