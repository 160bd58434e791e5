"""Painter: a renderer's picture, upright, in a framebuffer of the runtime.

Both eyes are drawn one by one, with an order of their own: one sort for both would be wrong where
their axes are not parallel, and save little (`bench xr` tells how much).
"""

from typing import TYPE_CHECKING, Any

from render.splats.quads import QuadRenderer
from render.types import Camera, Gaussians, Renderer

if TYPE_CHECKING:
    import moderngl

    from render.gl.contexts import GLContext

VERTEX = """
#version 330
out vec2 place;  // 0, 0 at the upper left, where a renderer's pictures begin
void main() {
    vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0;
    place = vec2(corner.x, 1.0 - corner.y);
    gl_Position = vec4(corner * 2.0 - 1.0, 0.0, 1.0);
}
"""
FRAGMENT = """
#version 330
uniform sampler2D picture;  // values of sRGB, as the framebuffer's texels are
in vec2 place;
out vec4 color;
void main() { color = vec4(texture(picture, place).rgb, 1.0); }
"""


class Painter:
    """Owns the renderer."""

    def __init__(self, context: "GLContext", renderer: Renderer) -> None:
        context.activate()
        self._context, self._renderer = context, renderer
        gl: Any = context.gl
        self._program = gl.program(vertex_shader=VERTEX, fragment_shader=FRAGMENT)
        self._triangle = gl.vertex_array(self._program, [])
        self._upload: moderngl.Texture = gl.texture((1, 1), 4)
        self._size = (1, 1)  # px, of that texture

    def paint(self, cloud: Gaussians, camera: Camera, target: "moderngl.Framebuffer") -> None:
        """Fill the target; a camera of another size is scaled."""
        self._renderer.draw(cloud, camera)
        picture = self._picture(camera)
        gl = self._context.gl
        target.use()
        gl.enable_only(gl.NOTHING)
        picture.use(0)
        self._triangle.render(gl.TRIANGLES, vertices=3)

    def close(self) -> None:
        self._renderer.close()

    def _picture(self, camera: Camera) -> "moderngl.Texture":
        """The renderer's picture on the GPU: where it is there already, it stays there."""
        if isinstance(self._renderer, QuadRenderer):
            return self._renderer.texture
        pixels, size = self._renderer.read_rgba(), (camera.width, camera.height)
        if self._size != size:
            self._upload.release()
            self._upload, self._size = self._context.gl.texture(size, 4), size
            self._upload.repeat_x = self._upload.repeat_y = False
        self._upload.write(pixels)
        return self._upload
