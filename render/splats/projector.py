"""Gaussians -> splats in depth order, and the tiles they reach: the first half of a draw."""

import numpy as np

from render.lighting import FILM, TOWARDS
from render.splats import projection, projection_kernels
from render.splats.depth_order import DepthOrder
from render.splats.projection_kernels import BROKEN, TILE_PX
from render.splats.reference import FRUSTUM_MARGIN
from render.splats.shine import SOFT
from render.splats.tile_pairs import Reaches
from render.types import FIELDS, U32, Camera, Floats, Gaussians, Shine
from sensors.threads import Threads

NOTHING = Shine(*(np.zeros(shape, np.float32) for shape in ((0, 4), 0, (4, 3))))
Place = tuple[Floats, Floats, Floats, tuple[np.float32, np.float32], np.float32]
AT_ONCE = 8192  # Gaussians; what a thread computes of them stays in its caches


class Projector:
    """Holds the splats of the last run; rows of undrawn ones are leftovers."""

    def __init__(self, threads: Threads) -> None:
        self._threads = threads
        self._slices: list[tuple[int, int]] = []  # of the Gaussians, what may be seen of them
        self._reserve(0)
        self._order = DepthOrder()
        self._place: tuple[Camera, Place] | None = None  # of the last run

    @property
    def dropped(self) -> int:
        """Gaussians of the last run that no picture can show."""
        return int(np.count_nonzero(self._depths == BROKEN))

    def run(self, gaussians: Gaussians, camera: Camera) -> U32:
        """Project; returns the indices [M] of the visible splats, nearest first."""
        self._project(gaussians, camera)
        return self._order.of(self._depths)

    def packed(self) -> U32:  # [N, 4]
        """The splats of the last run for a GPU, see shaders/splat.glsl."""
        x, y, p, q, r, log2_opacity, _ = self._ellipses
        bits_p, bits_q, bits_r = (factor.view(np.int32) for factor in (p, q, r))
        out = np.empty((len(x), 4), np.uint32)
        colors = self._colors.reshape(-1)
        projection_kernels.pack(x, y, bits_p, bits_q, bits_r, log2_opacity, colors, out.reshape(-1))
        return out

    def run_for_tiles(
        self,
        gaussians: Gaussians,
        camera: Camera,
        splats: Floats,  # -> [N, 9 and more] see projection.interleave
    ) -> tuple[U32, Reaches]:
        """Project; the visible splats [M], nearest first, and the tiles that they reach."""
        self._project(gaussians, camera)
        boxes, colors = self.boxes.reshape(-1), self._colors.reshape(-1)
        across, order = -(-camera.width // TILE_PX), [np.empty(0, np.uint32)]

        def sort_or_reach(part: int) -> None:
            if part == 0:  # the longest part, which cannot be shared
                order[0] = self._order.of(self._depths)
                return
            out = self._rows, self._reaches, self._further, splats
            projection.reach(*self._slices[part - 1], self._ellipses, colors, boxes, across, *out)

        self._threads.share(sort_or_reach, 1 + len(self._slices))
        return order[0], Reaches(self._reaches, self._further)

    def _project(self, gaussians: Gaussians, camera: Camera) -> None:
        gaussians.check()
        if len(gaussians) != len(self.boxes):
            self._reserve(len(gaussians))
        means, quats, scales, opacities, stored = (
            np.ascontiguousarray(getattr(gaussians, name), np.float32).reshape(-1)
            for name in FIELDS
        )
        self._slices = projection.shown_slices(opacities, AT_ONCE)
        self._depths.fill(BROKEN)
        if self._place is None or self._place[0] is not camera:  # mostly the same for long
            self._place = camera, place_of(camera)
        shine = gaussians.shine or NOTHING
        weights = np.ascontiguousarray(shine.weights).reshape(-1)
        mirrors = weights, shine.roughness, SOFT, TOWARDS, shine.lamps, FILM
        place = self._place[1]
        out = self._colors.reshape(-1), self._depths, self.boxes.reshape(-1), self._ellipses

        def project(part: int) -> None:
            first, last = self._slices[part]
            cloud = means, quats, scales, opacities, stored, mirrors
            projection.project(first, last, *cloud, *place, *out)

        self._threads.share(project, len(self._slices))

    def _reserve(self, count: int) -> None:
        self.boxes = np.zeros((count, 2), np.uint32)  # tiles: x0 | y0 << 16, x1 | y1 << 16
        self._ellipses = np.zeros((7, count), np.float32)
        self._colors = np.zeros((count, 3), np.float32)  # as seen from the camera
        self._depths = np.zeros(count, np.float32)  # mm, HIDDEN or BROKEN
        self._reaches = np.zeros(count, np.uint64)
        self._rows, self._further = np.zeros((2, count), np.uint32)


def place_of(camera: Camera) -> Place:
    """What projection.project wants of a camera."""
    across, down = (np.float32(-(-px // TILE_PX)) for px in (camera.width, camera.height))
    view, viewer = (a.astype(np.float32) for a in (camera.viewmat, camera.position))
    return view.reshape(-1), lens_of(camera), viewer, (across, down), np.float32(camera.near_mm)


def lens_of(camera: Camera) -> Floats:  # [8]
    """Focal lengths and centre (px), and the slopes between which the Jacobian is taken."""
    K, size = camera.K, np.array([camera.width, camera.height], np.float64)
    focal, centre = np.array([K[0, 0], K[1, 1]]), np.array([K[0, 2], K[1, 2]])
    margin = FRUSTUM_MARGIN * 0.5 * size
    low, high = -(centre + margin) / focal, (size - centre + margin) / focal
    return np.array([*focal, *centre, low[0], high[0], low[1], high[1]], np.float32)
