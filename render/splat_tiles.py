"""Splat renderer for software GL: two compute passes and the CPU between them.

The Gaussians are projected (`render/projector.py`), dealt to the tiles that their ellipses reach
(`render/tile_pairs.py`), and every tile is blended by itself, front to back, in float32
(shaders/tiles.comp.glsl).
"""

import numpy as np
from numpy.typing import NDArray

from render.contexts import GLContext
from render.projector import TILE_PX, U32, Projector
from render.storage import GrowingBuffer, splat_shader
from render.tile_pairs import deal
from render.types import Camera, Gaussians

LANES = 8  # tiles of a work group
DECKS = 16  # see share_out
EVERY = np.uint32(0xFFFFFFFF)  # a tile that looked at all of its pairs


def share_out(work: U32) -> U32:
    """Tiles with work, in the order of the lanes that draw them, filled up with no tile.

    Tiles with like work share a group, so that its lanes end together. Threads of the driver take
    runs of groups, so the groups are dealt out like cards: every run gets its share.
    """
    count = np.count_nonzero(work)
    order = np.full(-(-count // (LANES * DECKS)) * LANES * DECKS, len(work), np.uint32)
    order[:count] = np.argsort(work.astype(np.int32))[::-1][:count]
    return order.reshape(-1, DECKS, LANES).swapaxes(0, 1).ravel()


class TileRenderer:
    """Renderer for software GL (llvmpipe): as exact as float32, several times faster than quads."""

    def __init__(self, context: GLContext) -> None:
        context.activate()
        self._context, gl = context, context.gl
        self._projector = Projector(gl)
        self._program = gl.compute_shader(splat_shader("tiles.comp.glsl"))
        self._splats, self._pairs, self._starts, self._tiles, self._needs, self._pixels = (
            GrowingBuffer(gl) for _ in range(6)
        )
        self._needed = np.empty(0, np.uint32)  # [tiles] pairs until nothing behind was seen
        self._picture = np.empty((0, 0, 4), np.uint8)
        self._blank = (0.0, 0.0, 0.0), self._picture  # a background and its picture
        self.name = f"tiles on {context.renderer} ({context.backend})"

    def draw(self, gaussians: Gaussians, camera: Camera) -> None:
        """Draw one picture; its size is that of the camera."""
        self._context.activate()
        order = self._projector.run(gaussians, camera)
        across, down = -(-camera.width // TILE_PX), -(-camera.height // TILE_PX)
        boxes = self._projector.boxes.take(order, 0)
        pairs = deal(boxes, (across, down), boxes.view(np.uint8)[:, 8:])
        self._clear(camera)
        work = np.diff(pairs.starts)
        if len(self._needed) == len(work):  # the last picture tells where a list is cut short
            np.minimum(work, self._needed, out=work, where=work > 0)
        lanes = share_out(work)
        if len(lanes) == 0:
            return
        self._splats.write(self._projector.read_splats().take(order, 0))
        self._pairs.write(pairs.ranks)
        self._starts.write(np.append(pairs.starts, pairs.starts[-1:]))  # and those of no tile
        self._tiles.write(lanes)
        self._needs.write(np.full(len(work) + 1, EVERY))
        buffers = (self._splats, self._pairs, self._starts, self._tiles, self._needs, self._pixels)
        for binding, buffer in enumerate(buffers):
            buffer.bind(binding)
        self._program["size"] = (camera.width, camera.height)
        self._program["background"] = camera.background
        self._program["tiles_across"] = across
        self._program.run(len(lanes) // LANES)
        self._context.gl.memory_barrier()
        self._needed = np.empty(len(work), np.uint32)
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

    def _clear(self, camera: Camera) -> None:
        """Fill the picture with the background, which is all that tiles without splats show."""
        size = (camera.height, camera.width)
        if self._picture.shape[:2] != size:
            self._picture = np.empty((*size, 4), np.uint8)
        if self._blank[0] != camera.background or self._blank[1].shape[:2] != size:
            blank = np.zeros((*size, 4), np.uint8)
            blank[..., :3] = np.rint(255.0 * np.clip(camera.background, 0.0, 1.0))
            self._blank = camera.background, blank
        self._pixels.write(self._blank[1])

    def close(self) -> None:
        """Free everything, the context too; may be called twice."""
        self._context.close()
