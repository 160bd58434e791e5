"""The window on the screen: glfw, Dear ImGui on top of its GL context, full screen, pacing."""

import time
from typing import Any

import glfw
from imgui_bundle import imgui, implot

from app.process.child import lower_priority
from app.window.panels.theme import Fonts, load_fonts, set_style
from app.window.state.layout import MIN_SIZE, SIZE
from render.gl.contexts import GLContext, create_context
from sensors.types import NS

SOFTWARE_SHARE = 0.7  # of one core's time, at most, where the CPU draws the window
FALLBACK_HZ = 60


class Screen:
    """Opens the window; `begin` and `end` enclose a picture."""

    def __init__(self, title: str) -> None:
        self.context: GLContext = create_context("window", SIZE)
        self.window: Any = self.context.window
        glfw.set_window_title(self.window, title)
        imgui.create_context()
        implot.create_context()
        io = imgui.get_io()
        io.set_ini_filename("")
        io.config_flags |= imgui.ConfigFlags_.nav_enable_keyboard
        # Some desktops count in points and give more pixels a point, others count in pixels.
        self.density = self.pixels[0] / self.size[0]
        self.scale = glfw.get_window_content_scale(self.window)[0] / self.density
        width, height = (round(self.scale * length) for length in MIN_SIZE)
        glfw.set_window_size_limits(self.window, width, height, glfw.DONT_CARE, glfw.DONT_CARE)
        self.fonts: Fonts = load_fonts()
        set_style(self.scale)
        imgui.backends.glfw_init_for_opengl(_address(self.window), True)
        imgui.backends.opengl3_init("#version 330")
        if self.context.software:
            lower_priority(5)  # the tick goes first
            glfw.swap_interval(0)  # nothing waits for this screen; `end` paces
        else:
            glfw.swap_interval(1)
        self.see_through = bool(
            glfw.get_window_attrib(self.window, glfw.TRANSPARENT_FRAMEBUFFER)
        )  # the desktop shines through where alpha is 0
        self._normal = (*glfw.get_window_pos(self.window), *glfw.get_window_size(self.window))
        self._began_ns = self._next_ns = time.monotonic_ns()
        self.hz = 0.0  # pictures a second, lately

    @property
    def closing(self) -> bool:
        return bool(glfw.window_should_close(self.window))

    @property
    def size(self) -> tuple[int, int]:
        """In the desktop's units, which are those of mouse and panels."""
        width, height = glfw.get_window_size(self.window)
        return max(width, 1), max(height, 1)

    @property
    def pixels(self) -> tuple[int, int]:
        """In pixels."""
        width, height = glfw.get_framebuffer_size(self.window)
        return max(width, 1), max(height, 1)

    def begin(self) -> None:
        """Take the input and start a picture."""
        glfw.poll_events()
        imgui.backends.opengl3_new_frame()
        imgui.backends.glfw_new_frame()
        imgui.new_frame()

    def end(self) -> None:
        """Draw the panels over what was drawn, show all, and wait for the display."""
        imgui.render()
        self.context.gl.screen.use()
        imgui.backends.opengl3_render_draw_data(imgui.get_draw_data())
        glfw.swap_buffers(self.window)
        self._pace()

    def toggle_full_screen(self) -> None:
        if glfw.get_window_monitor(self.window):
            windowed: Any = None
            glfw.set_window_monitor(self.window, windowed, *self._normal, glfw.DONT_CARE)
            return
        self._normal = (*glfw.get_window_pos(self.window), *glfw.get_window_size(self.window))
        monitor = glfw.get_primary_monitor()
        mode = glfw.get_video_mode(monitor)
        glfw.set_window_monitor(
            self.window, monitor, 0, 0, mode.size.width, mode.size.height, mode.refresh_rate
        )

    @property
    def full_screen(self) -> bool:
        return bool(glfw.get_window_monitor(self.window))

    def close(self) -> None:
        imgui.backends.opengl3_shutdown()
        imgui.backends.glfw_shutdown()
        self.context.close()

    def _pace(self) -> None:
        now_ns = time.monotonic_ns()
        if self.context.software:
            monitor = glfw.get_primary_monitor()
            hz = glfw.get_video_mode(monitor).refresh_rate if monitor else 0
            period_ns = NS // (hz or FALLBACK_HZ)
            cost_ns = now_ns - self._began_ns
            self._next_ns = max(
                self._next_ns + period_ns,  # the display's grid
                self._began_ns + int(cost_ns / SOFTWARE_SHARE),
            )
            while (left_ns := self._next_ns - time.monotonic_ns()) > 0:
                time.sleep(left_ns / NS)
        began_ns, self._began_ns = self._began_ns, time.monotonic_ns()
        share = NS / max(self._began_ns - began_ns, 1)
        self.hz += (share - self.hz) * (0.05 if self.hz else 1.0)


def _address(window: Any) -> int:
    import ctypes

    return ctypes.cast(window, ctypes.c_void_p).value or 0
