"""Splat renderer for software GL: compiled loops prepare what one compute pass blends.

The Gaussians are projected (`tile_projector.py`), dealt to the tiles that their ellipses
reach (`tile_pairs.py`), and every tile is blended by itself, front to back, in float32
(shaders/tiles.comp.glsl).
"""

import numpy as np
from numpy.typing import NDArray

from render.gl.contexts import GLContext
from render.splats.projection_kernels import TILE_PX
from render.splats.projector import Projector
from render.splats.storage import GrowingBuffer, splat_shader
from render.splats.tile_pairs import bin_splats
from render.types import U32, Camera, Gaussians

LANES = 8  # tiles of a work group
INTERLEAVE = 16  # see schedule_tiles


def schedule_tiles(work: U32) -> U32:
    """Tiles with work, in the order of the lanes that draw them, filled up with no tile.

    Tiles with like work share a group, so that its lanes end together. Threads of the driver take
    runs of groups, so the groups are dealt out like cards: every run gets its share.
    """
    count = np.count_nonzero(work)
    order = np.full(-(-count // (LANES * INTERLEAVE)) * LANES * INTERLEAVE, len(work), np.uint32)
    short = np.minimum(work, 0xFFFF).astype(np.uint16)  # numpy sorts these by radix
    order[:count] = np.argsort(short, kind="stable")[::-1][:count]
    return order.reshape(-1, INTERLEAVE, LANES).swapaxes(0, 1).ravel()


class TileRenderer:
    """Renderer for software GL (llvmpipe): as exact as float32, several times faster than quads."""

    def __init__(self, context: GLContext) -> None:
        context.activate()
        self._context, gl = context, context.gl
        self._projector = Projector()
        self._program = gl.compute_shader(splat_shader("tiles.comp.glsl", version=430))
        self._splats, self._pairs, self._starts, self._tiles, self._needs, self._pixels = (
            GrowingBuffer(gl) for _ in range(6)
        )
        self._picture = np.empty((0, 0, 4), np.uint8)
        self._background: tuple[int, int, tuple[float, float, float]] | None = None
        self._covered = np.empty(0, np.bool_)  # [tiles] it shows more than the background
        self._needed = np.empty(0, np.uint32)  # [tiles] pairs until nothing behind was seen
        self.name = f"tiles on {context.renderer} ({context.backend})"

    def draw(self, gaussians: Gaussians, camera: Camera) -> None:
        """Draw one picture; its size is that of the camera."""
        self._context.activate()
        order = self._projector.run(gaussians, camera)
        across, down = -(-camera.width // TILE_PX), -(-camera.height // TILE_PX)
        pairs = bin_splats(
            self._projector.boxes, order, (across, down), self._projector.reached_tiles()
        )
        lanes = schedule_tiles(self._work(pairs.counts, camera))
        self._splats.write(self._projector.splats)
        self._pairs.write(pairs.splats)
        self._starts.write(pairs.starts)
        self._tiles.write(lanes)
        self._needs.reserve(pairs.starts.nbytes)
        self._pixels.reserve(self._picture.nbytes)
        lists = (self._pairs, self._starts, self._tiles, self._needs, self._pixels)
        for binding, buffer in enumerate((self._splats, *lists)):
            buffer.bind(binding)
        self._program["size"] = (camera.width, camera.height)
        self._program["background"] = camera.background
        self._program["tiles_across"] = across
        self._program.run(len(lanes) // LANES)
        self._context.gl.memory_barrier()
        self._needs.read(self._needed)

    @property
    def dropped(self) -> int:
        """Gaussians of the last draw that are NaN, infinite, without size or transparent."""
        return self._projector.dropped

    def read_rgba(self) -> NDArray[np.uint8]:
        """The last picture [H, W, 4]; alpha is coverage, the colours lie over the background."""
        self._context.activate()
        self._pixels.read(self._picture)
        self._context.check_errors("tiles")
        return self._picture

    def _work(self, counts: U32, camera: Camera) -> U32:
        """What each tile [tiles] costs, 0 for those that show the background and did before."""
        covered, background = counts > 0, (camera.width, camera.height, camera.background)
        if background == self._background:  # the last picture tells where a list is cut short
            work = np.minimum(counts, self._needed) + np.uint32(1)
            work[~(covered | self._covered)] = 0
        else:
            work = counts + np.uint32(1)
            self._background, self._needed = background, np.empty_like(work)
            self._picture = np.empty((camera.height, camera.width, 4), np.uint8)
        self._covered = covered
        return work

    def close(self) -> None:
        """Free everything, the context too; may be called twice."""
        self._context.close()
