"""Gaussians -> splats on the screen, on the GPU: the first pass of the quad renderer."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from render.depth_order import DepthOrder
from render.storage import GrowingBuffer, splat_shader
from render.types import FIELDS, Camera, Gaussians

if TYPE_CHECKING:
    import moderngl

U32 = NDArray[np.uint32]


class Projector:
    """Uploads Gaussians and leaves packed splats on the device; their depths come back."""

    def __init__(self, gl: "moderngl.Context") -> None:
        self._gl = gl
        self._program = gl.compute_shader(splat_shader("project.comp.glsl"))
        self._inputs = [GrowingBuffer(gl) for _ in FIELDS]
        self.splats, self._depth_buffer = GrowingBuffer(gl), GrowingBuffer(gl)
        self._depths = np.empty(0, np.float32)  # [N] mm, HIDDEN or BROKEN
        self._order = DepthOrder()
        self._uploaded: Gaussians | None = None  # one upload serves both eyes

    @property
    def dropped(self) -> int:
        """Gaussians of the last run that no picture can show."""
        return self._order.dropped

    def run(self, gaussians: Gaussians, camera: Camera) -> U32:
        """Project; returns the indices [M] of the visible splats, nearest first.

        The same Gaussians are uploaded once: their arrays must not change between two runs.
        """
        gaussians.check()
        n = len(gaussians)
        if n != len(self._depths):
            self._depths = np.empty(n, np.float32)
        if n == 0:
            return self._order.of(self._depths)
        for binding, (name, buffer) in enumerate(zip(FIELDS, self._inputs, strict=True)):
            if gaussians is not self._uploaded:
                buffer.write(np.ascontiguousarray(getattr(gaussians, name), np.float32))
            buffer.bind(binding)
        self._uploaded = gaussians
        for binding, (buffer, row_bytes) in enumerate(
            ((self.splats, 16), (self._depth_buffer, 4)), len(FIELDS)
        ):
            buffer.reserve(n * row_bytes)
            buffer.bind(binding)
        K, program = camera.K, self._program
        program["num_gaussians"] = n
        program["view"] = tuple(np.asarray(camera.viewmat, np.float64).T.ravel())
        program["lens"] = (K[0, 0], K[1, 1], K[0, 2], K[1, 2])
        program["size"] = (camera.width, camera.height)
        program["near_mm"] = camera.near_mm
        program.run((n + 63) // 64)
        self._gl.memory_barrier()
        self._depth_buffer.read(self._depths)
        return self._order.of(self._depths)
