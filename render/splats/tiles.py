"""Splat renderer for computers without a GPU: compiled loops on every CPU.

The Gaussians are projected (`projector.py`), dealt to the tiles that their ellipses reach
(`tile_pairs.py`), and every tile is blended by itself, front to back, in float32
(`blend_kernels.py`). A software driver's compute shader that did the last took three times as long.
"""

import numpy as np
from numpy.typing import NDArray

from render.gl.contexts import GLContext
from render.splats.blend_kernels import blend_tiles
from render.splats.projection_kernels import TILE_PX
from render.splats.projector import Projector
from render.splats.row_kernels import NUMBERS
from render.splats.tile_kernels import blended_tiles
from render.splats.tile_pairs import MAX_PAIRS, Pairs, Reaches, bin_splats
from render.types import U32, Camera, Gaussians
from sensors.threads import Threads

PARTS = 8  # of a picture's tiles, a thread
PORTIONS = 4  # of a picture's splats; as many with one thread as with eight, to the bit the same


class TileRenderer:
    """Renderer without GL: as exact as float32, many times faster than quads of software GL."""

    def __init__(self, context: GLContext) -> None:
        self._context = context  # of whoever shows the pictures
        self._threads = Threads()
        self._projector = Projector(self._threads)
        self._splats = np.empty((0, NUMBERS), np.float32)
        self._picture = np.empty((0, 0, 4), np.uint8)
        self._background: tuple[int, int, tuple[float, float, float]] | None = None
        self._covered = np.empty(0, np.bool_)  # [tiles] it shows more than the background
        self.name = f"tiles on {self._threads.count} CPUs, beside {context.renderer}"
        self.name += f" ({context.backend})"

    def draw(self, gaussians: Gaussians, camera: Camera) -> None:
        """Draw one picture; its size is that of the camera."""
        self._context.activate()
        if len(self._splats) != len(gaussians):
            self._splats = np.zeros((len(gaussians), NUMBERS), np.float32)
        order, reaches = self._projector.run_for_tiles(gaussians, camera, self._splats)
        portions = self._deal(order, reaches, camera)
        starts, splats = zip(*portions, strict=True)
        self._clear(camera, len(starts[0]) - 2)
        tiles = blended_tiles(starts, self._covered)
        background = np.array(camera.background, np.float32)
        picture = self._picture.view(np.int32)[..., 0]
        parts = PARTS * self._threads.count

        def blend(part: int) -> None:
            chosen = tiles[len(tiles) * part // parts : len(tiles) * (part + 1) // parts]
            blend_tiles(chosen, starts, splats, self._splats, background, picture)

        self._threads.share(blend, parts)

    @property
    def dropped(self) -> int:
        """Gaussians of the last draw that are NaN, infinite, without size or transparent."""
        return self._projector.dropped

    def read_rgba(self) -> NDArray[np.uint8]:
        """The last picture [H, W, 4]; alpha is coverage, the colours lie over the background."""
        return self._picture

    def _deal(self, order: U32, reaches: Reaches, camera: Camera) -> list[Pairs]:
        """The splats of each tile in portions, the nearest first."""
        size = -(-camera.width // TILE_PX), -(-camera.height // TILE_PX)
        portions = [Pairs(order, order)] * PORTIONS

        def deal(part: int) -> None:
            k = PORTIONS - 1 - part  # the farthest has the most pairs: it must not be the last
            portion = order[len(order) * k // PORTIONS : len(order) * (k + 1) // PORTIONS]
            portions[k] = bin_splats(
                self._projector.boxes, portion, size, reaches, MAX_PAIRS // PORTIONS
            )

        self._threads.share(deal, PORTIONS)
        return portions

    def _clear(self, camera: Camera, tiles: int) -> None:
        """A picture of the background where the last one was of another size or over another."""
        background = camera.width, camera.height, camera.background
        if background == self._background:
            return
        levels = np.array([*camera.background, 0.0], np.float32) * 255 + np.float32(0.5)
        self._picture = np.empty((camera.height, camera.width, 4), np.uint8)
        self._picture[:] = levels.astype(np.uint8)
        self._background, self._covered = background, np.zeros(tiles, np.bool_)

    def close(self) -> None:
        """Free everything, the context too; may be called twice."""
        self._threads.close()
        self._context.close()
