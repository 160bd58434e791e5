"""Splat renderer for GPUs: one instanced quad a Gaussian.

Draws the splats of the same projection as render/splats/tiles.py, blended back to front,
premultiplied, in RGBA16F: 8-bit blending loses 10 dB and more. Needs OpenGL 3.3 only.
"""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from render.gl.contexts import GLContext, free
from render.splats.projector import Projector
from render.types import Camera, Gaussians
from sensors.threads import Threads

if TYPE_CHECKING:
    import moderngl

SHADERS = Path(__file__).parents[1] / "shaders"


class QuadRenderer:
    """Renderer for hardware GL, macOS (4.1) included: rasteriser and blending units do the work."""

    def __init__(self, context: GLContext) -> None:
        context.activate()
        self._context, gl = context, context.gl
        self._threads = Threads()
        self._projector = Projector(self._threads)
        unpack, vertex, fragment = (
            (SHADERS / name).read_text()
            for name in ("splat.glsl", "quads.vert.glsl", "quads.frag.glsl")
        )
        self._program = gl.program(
            vertex_shader=f"#version 330\n{unpack}\n{vertex}", fragment_shader=fragment
        )
        self._instances, self._quad = self._room(0)
        self._target = gl.framebuffer([gl.texture((1, 1), 4, dtype="f2")])
        self._picture = np.empty((1, 1, 4), np.uint8)
        self.name = f"quads on {context.renderer} ({context.backend})"

    def draw(self, gaussians: Gaussians, camera: Camera) -> None:
        """Draw one picture; its size is that of the camera."""
        self._context.activate()
        gl, size = self._context.gl, (camera.width, camera.height)
        order = self._projector.run(gaussians, camera)
        self._resize(size)
        self._target.use()
        self._target.clear(*camera.background, 0.0)
        if len(order) == 0:
            return
        gl.enable_only(gl.BLEND)
        gl.blend_func = gl.ONE, gl.ONE_MINUS_SRC_ALPHA
        splats = self._projector.packed()[order[::-1]]
        if splats.nbytes > self._instances.size:
            self._quad.release()
            self._instances.release()
            self._instances, self._quad = self._room(len(splats))
        self._instances.orphan()
        self._instances.write(splats)
        self._program["size"] = size
        self._quad.render(gl.TRIANGLE_STRIP, vertices=4, instances=len(order))

    @property
    def dropped(self) -> int:
        """Gaussians of the last draw that are NaN, infinite, without size or transparent."""
        return self._projector.dropped

    @property
    def texture(self) -> "moderngl.Texture":
        """The last picture where it was drawn, top row first; valid until the next draw."""
        return self._target.color_attachments[0]  # pyright: ignore[reportReturnType]

    def read_rgba(self) -> NDArray[np.uint8]:
        """The last picture [H, W, 4]; alpha is coverage, the colours lie over the background."""
        self._context.activate()
        self._target.read_into(self._picture, components=4, alignment=4)
        self._context.check_errors("quads")
        return self._picture

    def close(self) -> None:
        """Free everything, the context too; may be called twice."""
        self._threads.close()
        self._context.close()

    def _room(self, count: int) -> "tuple[moderngl.Buffer, moderngl.VertexArray]":
        """Memory for a quarter more splats than that, as instances of the quad."""
        buffer = self._context.gl.buffer(reserve=16 * max(count * 5 // 4, 64), dynamic=True)
        return buffer, self._context.gl.vertex_array(self._program, [(buffer, "4u/i", "words")])

    def _resize(self, size: tuple[int, int]) -> None:
        if self._target.size == size:
            return
        gl, old = self._context.gl, self._target
        self._target = gl.framebuffer([gl.texture(size, 4, dtype="f2")])
        self._picture = np.empty((size[1], size[0], 4), np.uint8)
        free(old)
