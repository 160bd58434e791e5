"""Splat renderer for software GL: two compute passes with a numpy sort between them.

Pass A projects the Gaussians (shaders/project.comp.glsl), numpy sorts (splat, tile) pairs by tile
and depth, pass B blends tile by tile, front to back, in float32 (shaders/tiles.comp.glsl).
"""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from render.contexts import GLContext
from render.errors import InputError
from render.types import Camera, Gaussians

if TYPE_CHECKING:
    import moderngl

SHADERS = Path(__file__).parent / "shaders"
TILE_PX = 8
LANES = 8  # tiles of a work group
DECKS = 16  # see share_out
FIELDS = ("means", "quats", "scales", "opacities", "colors")  # bindings 0..4 of pass A
HIDDEN, BROKEN = (
    np.float32(3.0e38),
    np.float32(3.2e38),
)  # depths of undrawn splats, as in the shader
MAX_PAIRS = 1 << 25  # (splat, tile) pairs of a picture; 128 MiB
LOW_16, SHIFT_16 = np.uint32(0xFFFF), np.uint32(16)

U32 = NDArray[np.uint32]


class GrowingBuffer:
    """A storage buffer that is allocated anew only when it must grow."""

    def __init__(self, gl: "moderngl.Context") -> None:
        self._gl, self._limit = gl, int(gl.info["GL_MAX_SHADER_STORAGE_BLOCK_SIZE"])
        self.buffer = gl.buffer(reserve=1024, dynamic=True)

    def reserve(self, num_bytes: int) -> None:
        if num_bytes > self.buffer.size:
            if num_bytes > self._limit:
                raise InputError(
                    f"GL buffer: expected at most {self._limit} bytes, got {num_bytes}; "
                    "draw fewer Gaussians or a smaller picture"
                )
            self.buffer.release()
            self.buffer = self._gl.buffer(
                reserve=min(num_bytes * 5 // 4, self._limit), dynamic=True
            )

    def write(self, array: NDArray) -> None:
        self.reserve(array.nbytes)
        self.buffer.write(array)

    def read(self, array: NDArray) -> None:
        self.buffer.read_into(array, size=array.nbytes)

    def bind(self, binding: int) -> None:
        self.buffer.bind_to_storage_buffer(binding)


class Projector:
    """Pass A: Gaussians in, packed splats in numpy out, nearest first, invisible ones gone."""

    def __init__(self, gl: "moderngl.Context") -> None:
        self._gl = gl
        self._program = gl.compute_shader((SHADERS / "project.comp.glsl").read_text())
        self._inputs = [GrowingBuffer(gl) for _ in FIELDS]
        self._outputs = [GrowingBuffer(gl) for _ in range(3)]
        self.dropped = 0  # Gaussians of the last run that no picture can show
        self._splats = np.empty((0, 4), np.uint32)  # layout in the shader
        self._depths = np.empty(0, np.float32)  # [N] mm, HIDDEN or BROKEN
        self._rects = np.empty((0, 2), np.uint32)  # tiles: x0 | y0 << 16, x1 | y1 << 16

    def run(self, gaussians: Gaussians, camera: Camera) -> tuple[U32, U32]:
        """Project and sort: splats [M, 4] and their tiles [M, 2], nearest first."""
        gaussians.check()
        n = len(gaussians)
        if n != len(self._depths):
            self._depths = np.empty(n, np.float32)
            self._splats, self._rects = np.empty((n, 4), np.uint32), np.empty((n, 2), np.uint32)
        if n == 0:
            return self._splats, self._rects
        for binding, (name, buffer) in enumerate(zip(FIELDS, self._inputs, strict=True)):
            buffer.write(np.ascontiguousarray(getattr(gaussians, name), np.float32))
            buffer.bind(binding)
        results = (self._splats, self._depths, self._rects)
        for binding, (buffer, result) in enumerate(
            zip(self._outputs, results, strict=True), len(FIELDS)
        ):
            buffer.reserve(result.nbytes)
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
        for buffer, result in zip(self._outputs, results, strict=True):
            buffer.read(result)
        self.dropped = int(np.count_nonzero(self._depths == BROKEN))
        order = depth_order(self._depths)
        return self._splats.take(order, 0), self._rects.take(order, 0)


def depth_order(depths: NDArray[np.float32]) -> U32:
    """Indices [M] of the visible splats, nearest first; equal depths in index order."""
    # Positive floats sort like their bits; a sort of 64-bit keys is stable and beats argsort.
    keys = depths.view(np.uint32).astype(np.uint64) << np.uint64(32)
    keys |= np.arange(len(keys), dtype=np.uint64)
    keys = np.sort(keys[depths < HIDDEN])
    return keys.astype(np.uint32)


def sort_by_tile(rects: U32, size: tuple[int, int]) -> tuple[U32, U32, int]:
    """All (tile, splat) pairs, by tile and then by depth.

    rects [M, 2]: tiles of the splats, nearest first; size: tiles across, down. Returns pairs [P],
    starts [tiles + 1] and a mask: tile i has the splats pairs[starts[i]:starts[i + 1]] & mask.
    """
    num_tiles = size[0] * size[1]
    bits = max(1, int(len(rects) - 1).bit_length())
    dtype = np.uint32 if bits + (num_tiles - 1).bit_length() <= 32 else np.int64
    low, high = rects[:, 0], rects[:, 1]
    x0, y0 = (low & LOW_16).astype(dtype), (low >> SHIFT_16).astype(dtype)
    width = (high & LOW_16).astype(dtype) - x0
    height = (high >> SHIFT_16).astype(dtype) - y0
    # A key is tile << bits | rank in depth; its arithmetic may wrap below zero and back.
    step_x, step_y = dtype(1 << bits), dtype(size[0] << bits)
    total = int(np.dot(width.astype(np.int64), height.astype(np.int64)))
    if total > MAX_PAIRS:
        raise InputError(
            f"splats: expected at most {MAX_PAIRS} (splat, tile) pairs, got {total}; "
            "draw fewer or smaller Gaussians, or move the camera away"
        )
    keys = y0 * step_y + x0 * step_x + np.arange(len(rects), dtype=dtype)
    keys = expand(keys, height, step_y)  # one key a row of tiles
    keys = expand(keys, np.repeat(width, height), step_x)  # one key a tile
    keys.sort()
    starts = np.searchsorted(keys, np.arange(num_tiles, dtype=dtype) * step_x)
    starts = np.append(starts, len(keys)).astype(np.uint32)
    return keys.astype(np.uint32, copy=False), starts, (1 << bits) - 1


def share_out(starts: U32) -> U32:
    """Tiles in the order of the lanes that draw them, filled up with an empty tile.

    Tiles with lists of like length share a group, so that its lanes end together. Threads of the
    driver take runs of groups, so the groups are dealt out like cards: every run gets its share.
    """
    num_tiles = len(starts) - 1
    order = np.full(-(-num_tiles // (LANES * DECKS)) * LANES * DECKS, num_tiles, np.uint32)
    order[:num_tiles] = np.argsort(np.diff(starts).astype(np.int32))[::-1]
    return order.reshape(-1, DECKS, LANES).swapaxes(0, 1).ravel()


def expand(keys: NDArray, counts: NDArray, step: np.generic) -> NDArray:
    """Replace keys[i] by keys[i] + step * (0, 1, .. counts[i] - 1)."""
    first = np.cumsum(counts, dtype=keys.dtype) - counts
    keys = np.repeat(keys - first * step, counts)
    keys += np.arange(len(keys), dtype=keys.dtype) * step
    return keys


class TileRenderer:
    """Renderer for software GL (llvmpipe): as exact as float32, several times faster than quads."""

    def __init__(self, context: GLContext) -> None:
        context.activate()
        self._context, gl = context, context.gl
        self._projector = Projector(gl)
        self._program = gl.compute_shader((SHADERS / "tiles.comp.glsl").read_text())
        self._splats, self._pairs, self._starts, self._tiles, self._pixels = (
            GrowingBuffer(gl) for _ in range(5)
        )
        self._picture = np.empty((0, 0, 4), np.uint8)
        self.name = f"tiles on {context.renderer} ({context.backend})"

    def draw(self, gaussians: Gaussians, camera: Camera) -> None:
        """Draw one picture; its size is that of the camera."""
        self._context.activate()
        splats, rects = self._projector.run(gaussians, camera)
        tiles = -(-camera.width // TILE_PX), -(-camera.height // TILE_PX)
        pairs, starts, rank_mask = sort_by_tile(rects, tiles)
        self._splats.write(splats)
        self._pairs.write(pairs)
        self._starts.write(np.append(starts, starts[-1:]))  # and an empty tile
        order = share_out(starts)
        self._tiles.write(order)
        if self._picture.shape[:2] != (camera.height, camera.width):
            self._picture = np.empty((camera.height, camera.width, 4), np.uint8)
        self._pixels.reserve(self._picture.nbytes)
        buffers = (self._splats, self._pairs, self._starts, self._tiles, self._pixels)
        for binding, buffer in enumerate(buffers):
            buffer.bind(binding)
        self._program["size"] = (camera.width, camera.height)
        self._program["rank_mask"] = rank_mask
        self._program["background"] = camera.background
        self._program["tiles_across"] = tiles[0]
        self._program.run(len(order) // LANES)
        self._context.gl.memory_barrier()

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

    def close(self) -> None:
        """Free everything, the context too; may be called twice."""
        self._context.close()
