"""The first splat renderer of this project, kept as the base line of `livedrive bench render`.

Two compute passes with a numpy sort between them, as today, but 32-byte splats in the order of the
Gaussians, one exponential a pixel and one (splat, tile) pair a turn of the loop.
"""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from render.contexts import GLContext
from render.projection_kernels import HIDDEN, TILE_PX
from render.storage import GrowingBuffer
from render.tile_pairs import U32
from render.types import FIELDS, Camera, Gaussians

if TYPE_CHECKING:
    import moderngl

SHADERS = Path(__file__).parent


class Projector:
    """Pass A: uploads Gaussians and leaves splats on the device, depths and tiles in numpy."""

    def __init__(self, gl: "moderngl.Context") -> None:
        self._gl = gl
        self._program = gl.compute_shader((SHADERS / "project.comp.glsl").read_text())
        self._inputs = [GrowingBuffer(gl) for _ in FIELDS]
        self._depth_buffer, self._rect_buffer = GrowingBuffer(gl), GrowingBuffer(gl)
        self.splats = GrowingBuffer(gl)  # 32 bytes a Gaussian, layout in the shader
        self.depths = np.empty(0, np.float32)  # [N] mm, HIDDEN for invisible ones
        self.rects = np.empty((0, 4), np.uint16)  # [N, 4] tiles: x0 y0 x1 y1, ends excluded

    def run(self, gaussians: Gaussians, camera: Camera) -> None:
        gaussians.check()
        n = len(gaussians)
        if n != len(self.depths):
            self.depths, self.rects = np.empty(n, np.float32), np.empty((n, 4), np.uint16)
        if n == 0:
            return
        for binding, (name, buffer) in enumerate(zip(FIELDS, self._inputs, strict=True)):
            buffer.write(np.ascontiguousarray(getattr(gaussians, name), np.float32))
            buffer.bind(binding)
        for binding, (buffer, row) in enumerate(
            ((self.splats, 32), (self._depth_buffer, 4), (self._rect_buffer, 8)), len(FIELDS)
        ):
            buffer.reserve(n * row)
            buffer.bind(binding)
        K, program = camera.K, self._program
        program["num_gaussians"] = n
        program["view"] = tuple(np.asarray(camera.viewmat, np.float64).T.ravel())
        program["lens"] = (K[0, 0], K[1, 1], K[0, 2], K[1, 2])
        program["size"] = (camera.width, camera.height)
        program["tile"] = (TILE_PX, TILE_PX)
        program["near_mm"] = camera.near_mm
        program.run((n + 63) // 64)
        self._gl.memory_barrier()
        self._depth_buffer.read(self.depths)
        self._rect_buffer.read(self.rects)


def depth_order(depths: NDArray[np.float32]) -> U32:
    """Indices [M] of the visible splats, nearest first; equal depths in index order."""
    # Positive floats sort like their bits; a sort of 64-bit keys is stable and beats argsort.
    keys = depths.view(np.uint32).astype(np.uint64) << np.uint64(32)
    keys |= np.arange(len(keys), dtype=np.uint64)
    keys = np.sort(keys[depths < HIDDEN])
    return keys.astype(np.uint32)


def sort_by_tile(order: U32, rects: NDArray[np.uint16], size: tuple[int, int]) -> tuple[U32, U32]:
    """All (tile, splat) pairs, by tile and then by depth.

    order [M]: splats, nearest first; rects [N, 4]: tiles of all splats; size: tiles across, down.
    Returns splats [P] and starts [tiles + 1]: tile i has splats[starts[i]:starts[i + 1]].
    """
    num_tiles, rects = size[0] * size[1], rects[order]
    bits = max(1, int(len(rects) - 1).bit_length())
    dtype = np.uint32 if bits + (num_tiles - 1).bit_length() <= 32 else np.int64
    x0, y0, x1, y1 = rects.T.astype(dtype)
    # A key is tile << bits | rank in depth; its arithmetic may wrap below zero and back.
    step_x, step_y = dtype(1 << bits), dtype(size[0] << bits)
    width, height = x1 - x0, y1 - y0
    keys = y0 * step_y + x0 * step_x + np.arange(len(rects), dtype=dtype)
    keys = expand(keys, height, step_y)  # one key a row of tiles
    keys = expand(keys, np.repeat(width, height), step_x)  # one key a tile
    keys.sort()
    starts = np.searchsorted(keys, np.arange(num_tiles, dtype=dtype) * step_x)
    starts = np.append(starts, len(keys)).astype(np.uint32)
    return order[keys & (step_x - dtype(1))], starts


def expand(keys: NDArray, counts: NDArray, step: np.generic) -> NDArray:
    """Replace keys[i] by keys[i] + step * (0, 1, .. counts[i] - 1)."""
    first = np.cumsum(counts, dtype=keys.dtype) - counts
    keys = np.repeat(keys - first * step, counts)
    keys += np.arange(len(keys), dtype=keys.dtype) * step
    return keys


class FirstTileRenderer:
    """Satisfies Renderer; counts no broken Gaussians."""

    dropped = 0

    def __init__(self, context: GLContext) -> None:
        context.activate()
        self._context, gl = context, context.gl
        self._projector = Projector(gl)
        self._program = gl.compute_shader((SHADERS / "tiles.comp.glsl").read_text())
        self._pairs, self._starts, self._pixels = (GrowingBuffer(gl) for _ in range(3))
        self._picture = np.empty((0, 0, 4), np.uint8)
        self.name = f"first tiles on {context.renderer} ({context.backend})"

    def draw(self, gaussians: Gaussians, camera: Camera) -> None:
        """Draw one picture; its size is that of the camera."""
        self._context.activate()
        self._projector.run(gaussians, camera)
        order = depth_order(self._projector.depths)
        tiles = -(-camera.width // TILE_PX), -(-camera.height // TILE_PX)
        pairs, starts = sort_by_tile(order, self._projector.rects, tiles)
        self._pairs.write(pairs)
        self._starts.write(starts)
        if self._picture.shape[:2] != (camera.height, camera.width):
            self._picture = np.empty((camera.height, camera.width, 4), np.uint8)
        self._pixels.reserve(self._picture.nbytes)
        buffers = (self._projector.splats, self._pairs, self._starts, self._pixels)
        for binding, buffer in enumerate(buffers):
            buffer.bind(binding)
        self._program["size"] = (camera.width, camera.height)
        self._program["background"] = camera.background
        self._program.run(*tiles)
        self._context.gl.memory_barrier()

    def read_rgba(self) -> NDArray[np.uint8]:
        """The last picture [H, W, 4]; alpha is coverage, the colours lie over the background."""
        self._context.activate()
        self._pixels.read(self._picture)
        self._context.check_errors("tiles")
        return self._picture

    def close(self) -> None:
        """Free everything, the context too; may be called twice."""
        self._context.close()
