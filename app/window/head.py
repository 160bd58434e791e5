"""The head in the window: decodes, draws, and lays the picture over the background."""

import time
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from app.call.table.company import Company
from app.call.table.seats import Seats
from app.drive.background import Fill, straight_alpha
from app.window.state.layout import Rect
from render.cameras import Orbit
from render.decoder import identity
from render.decoder.decoder import Decoder
from render.gl.contexts import GLContext
from render.splats.renderer import wrap_context
from render.types import Density
from sensors import rotation

BLACK = (0.0, 0.0, 0.0)  # over black, colours come out premultiplied by coverage
STILL_PX = 1024
MAX_PX = 2048
Code = NDArray[np.float32]

VERTEX = """
#version 330
void main() {
    gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0);
}
"""
FRAGMENT = """
#version 330
uniform sampler2D head;      // premultiplied
uniform vec4 area;           // x, y, width, height in px from the upper left
uniform float window_height; // px
uniform vec4 background;     // premultiplied
uniform bool studio;         // a soft light behind the head instead
uniform bool checkered;      // squares instead: where the desktop cannot shine through
uniform bool mirror;
out vec4 color;

float noise(vec2 p) { return fract(52.9829189 * fract(dot(p, vec2(0.06711056, 0.00583715)))); }

void main() {
    vec2 place = vec2(gl_FragCoord.x, window_height - gl_FragCoord.y);
    vec2 uv = (place - area.xy) / area.zw;
    vec4 behind = background;
    if (studio) {
        float far = length((uv - vec2(0.5, 0.42)) * area.zw) / max(area.z, area.w);
        float light = mix(0.225, 0.085, smoothstep(0.0, 0.78, far));
        light += (noise(gl_FragCoord.xy) - 0.5) / 255.0;  // no bands in the gradient
        behind = vec4(vec3(0.93, 0.98, 1.07) * light, 1.0);
    }
    if (checkered) {
        ivec2 square = ivec2(place) / 16;
        behind = vec4(vec3((square.x + square.y) % 2 == 0 ? 0.30 : 0.24), 1.0);
    }
    vec4 front = vec4(0.0);
    if (all(greaterThanEqual(uv, vec2(0.0))) && all(lessThan(uv, vec2(1.0))))
        front = texture(head, mirror ? vec2(1.0 - uv.x, uv.y) : uv);
    color = front + behind * (1.0 - front.a);
}
"""


class HeadView:
    """Owns the decoder, the identity and the renderer of the window."""

    def __init__(
        self,
        context: GLContext,
        avatar: str,
        size: int,
        gaussians: Density,
        seats: str | None = None,  # handle of a call's seats
    ) -> None:
        self._context, self._size = context, size
        self.decoder = Decoder.load(gaussians=gaussians)
        self.company = None if seats is None else Company(self.decoder, Seats(seats))
        self.identity, self._chosen = identity.load(avatar), avatar
        self._renderer = wrap_context(context)
        gl: Any = context.gl
        self._program = gl.program(vertex_shader=VERTEX, fragment_shader=FRAGMENT)
        self._triangle = gl.vertex_array(self._program, [])
        self._texture: Any = gl.texture((1, 1), 4)

    def choose(self, avatar: str) -> bool:
        """Whether another one is to be drawn from now on. Raises InputError, once, where its file
        is damaged; the old one stays."""
        if avatar == self._chosen:
            return False
        self._chosen = avatar
        self.identity = identity.load(avatar)
        return True

    def draw(self, expression: Code, gaze: Code, head: Code, orbit: Orbit, view: Rect) -> None:
        """Draw the head for a view of this size; a CPU draws fewer pixels and scales them up."""
        short = min(view.width, view.height)
        limit = self._size if self._context.software else MAX_PX
        share = min(1.0, limit / short)
        width, height = max(round(view.width * share), 1), max(round(view.height * share), 1)
        picture = self._picture(expression, gaze, head, orbit, width, height)
        if self._texture.size != (width, height):
            self._texture.release()
            self._texture = self._context.gl.texture((width, height), 4)
            self._texture.repeat_x = self._texture.repeat_y = False
        self._texture.write(picture)

    def show(
        self,
        view: Rect,
        window: tuple[int, int],
        background: Fill,
        mirror: bool,
        see_through: bool,  # the desktop shines through where alpha is 0
    ) -> None:
        """Fill the view with the background and the last picture."""
        gl, program = self._context.gl, self._program
        gl.screen.use()
        gl.viewport = (0, 0, *window)
        left, width = round(view.x), round(view.width)
        gl.screen.scissor = (left, 0, width, window[1])  # the sidebar covers the rest
        gl.enable_only(moderngl.NOTHING)
        self._texture.use(0)
        program["area"] = tuple(view)
        program["window_height"] = window[1]
        program["studio"] = background == "studio"
        red, green, blue, alpha = (0.0,) * 4 if background == "studio" else background
        program["background"] = (red * alpha, green * alpha, blue * alpha, alpha)
        program["checkered"] = alpha < 1.0 and background != "studio" and not see_through
        program["mirror"] = mirror
        self._triangle.render(moderngl.TRIANGLES, vertices=3)
        gl.screen.scissor = (0, 0, *window)

    def still(self, expression: Code, gaze: Code, head: Code, orbit: Orbit) -> NDArray[np.uint8]:
        """A square picture [H, W, 4] with straight alpha and nothing behind the head."""
        picture = self._picture(expression, gaze, head, orbit, STILL_PX, STILL_PX)
        return straight_alpha(picture)

    def _picture(
        self, expression: Code, gaze: Code, head: Code, orbit: Orbit, width: int, height: int
    ) -> NDArray[np.uint8]:
        *numbers, breath = head.tolist()
        pose = rotation.checked(numbers[:3], numbers[3:])
        _, gaussians = self.decoder.decode(expression, gaze, self.identity, pose, breath)
        if self.company is not None:
            gaussians = self.company.around(gaussians, time.monotonic_ns())
        self._renderer.draw(gaussians, orbit.camera(width, height, BLACK))
        return self._renderer.read_rgba()
