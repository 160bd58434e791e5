"""What happens in the window, picture by picture.

shared ticks -> Interpolation -> decode -> draw -> background, panels -> screen
             -> History -> sidebar          controls -> loop
"""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from imgui_bundle import imgui

from app.window.head import Code, HeadView
from app.window.panels import overlay, sidebar
from app.window.panels.eyes import EyeMarks
from app.window.screen import Screen
from app.window.state import actions
from app.window.state.interpolation import AT_REST
from app.window.state.layout import Rect, arrange
from app.window.state.shared import SharedMemory, WindowInfo
from app.window.state.window_state import State
from render.cameras import Orbit
from render.types import AHEAD
from sensors import files
from sensors.types import EYE_SIZE, InputError

DEGREES_PER_PX, ZOOM_PER_STEP = 0.35, 1.1
CHROME_S = 2.5  # with hidden panels the toolbar shows this long after the mouse has moved
REST: tuple[Code, Code, Code] = np.zeros(256, np.float32), AHEAD, AT_REST


class Window:
    """Everything behind the screen."""

    def __init__(self, screen: Screen, memory: SharedMemory, info: WindowInfo) -> None:
        self._screen, self._memory = screen, memory
        self.state = State(info, memory.controls, recording=bool(memory.controls["recording"]))
        self.state.choose_background(info.background)
        self._head = HeadView(screen.context, info.avatar, info.size, info.gaussians, info.seats)
        self._marks = EyeMarks(self._head.decoder, self._head.identity)
        self._toolbar = actions.toolbar(info.can_record)
        self._number = -1  # of the newest tick
        gl = screen.context.gl
        self._eyes = [gl.texture((EYE_SIZE, EYE_SIZE), 1) for _ in range(2)]
        for texture in self._eyes:
            texture.swizzle = "RRR1"
        self._eye_textures: list[Any] = [imgui.ImTextureRef(t.glo) for t in self._eyes]

    def run(self, loop_lives: Callable[[], bool]) -> None:
        """Until the run ends, the window is closed, or the loop is gone."""
        screen, controls = self._screen, self.state.controls
        while not controls["ending"] and loop_lives():
            self._take_ticks()
            self.picture()
            controls["frames"] += 1
            controls["ready"] = True
            if screen.closing:
                controls["closed"] = True
                break
        screen.close()

    def picture(self) -> None:
        """One picture of the window."""
        screen, state = self._screen, self.state
        screen.begin()
        for name in actions.pressed():
            self.perform(name)
        layout = arrange(*screen.size, screen.scale, state.panels, len(self._toolbar))
        self._hand(layout.view)
        shown = self._draw_head(layout.view.times(screen.density), screen.pixels)
        if state.panels or state.still_s < CHROME_S:
            overlay.title(state, screen.fonts, layout.title)
            overlay.status(state, screen.fonts, layout.status)
            if self._head.company is not None:
                overlay.call(self._head.company.lines, screen.fonts, layout.title)
            for name in overlay.toolbar(state, screen.fonts, layout, self._toolbar):
                self.perform(name)
        overlay.toast(state, screen.fonts, layout.toast)
        if layout.sidebar:
            marks = [self._marks.of(eye, *shown) for eye in range(2)] if shown else None
            sidebar.draw(state, screen.fonts, layout.sidebar, self._eye_textures, marks)
        if state.help:
            overlay.help_page(state, screen.fonts, layout.view)
        screen.end()
        state.hz = screen.hz

    def perform(self, name: str) -> None:
        """Do an action of app.window.state.actions."""
        state, controls = self.state, self.state.controls
        if name in ("mirror", "panels", "help"):
            setattr(state, name, not getattr(state, name))
        elif name == "mute":
            controls["muted"] = not controls["muted"]
        elif name == "record" and state.info.can_record:
            controls["recording"] = state.recording = not controls["recording"]
            state.recording_from = state.history.frames
        elif name == "recentre":
            state.orbit = Orbit()
            controls["recentred"] += 1
        elif name == "restart":
            controls["resets"] += 1
            state.say("The head starts anew")
        elif name == "picture":
            self._save_picture()
        elif name == "background":
            state.next_background()
        elif name == "emotion":
            state.next_emotion()
        elif name in ("less", "more"):
            state.more_emotion(0.1 if name == "more" else -0.1)
        elif name == "smooth":
            state.motion.smooth = not state.motion.smooth
            state.say("Smooth motion " + ("on" if state.motion.smooth else "off"))
        elif name == "full_screen":
            self._screen.toggle_full_screen()
        elif name == "escape":
            if self._screen.full_screen and not state.help:
                self._screen.toggle_full_screen()
            state.help = False

    def _take_ticks(self) -> None:
        state = self.state
        if state.recording and not state.controls["recording"]:  # the loop took it back
            state.recording = False
            state.say("The recording has stopped: the disk is full, too slow or read-only")
        ticks = self._memory.ticks.after(self._number)
        for tick in ticks:
            state.history.add(tick)
            moments = int(tick["t_ns"]), int(tick["posted_ns"])
            state.motion.push(*moments, tick["expression"], tick["gaze"], tick["head"])
        if ticks:
            self._number = int(ticks[-1]["number"])
            state.controls["shown"] = ticks[-1]["index"]
            for texture, picture in zip(self._eyes, state.history.eyes, strict=True):
                texture.write(picture)

    def _draw_head(self, view: Rect, window: tuple[int, int]) -> tuple[Code, Code] | None:
        """View and window in pixels; returns the expression and gaze that were drawn."""
        state, head = self.state, self._head
        try:
            if head.choose(state.avatar):
                self._marks = EyeMarks(head.decoder, head.identity)
        except (InputError, OSError):
            state.say(f"The file of {state.label} cannot be read; livedrive doctor tells more")
        began_ns = time.monotonic_ns()
        shown = state.motion.at(began_ns) or REST
        head.draw(*shown, state.orbit, view)
        cost_ms = (time.monotonic_ns() - began_ns) / 1e6
        state.draw_ms += (cost_ms - state.draw_ms) * (0.1 if state.draw_ms else 1.0)
        head.show(view, window, state.fill, state.mirror, self._screen.see_through)
        return shown[:2] if self._number >= 0 else None

    def _hand(self, view: Rect) -> None:
        """Turn, move and zoom with the mouse, where no panel wants it."""
        io, state, button = imgui.get_io(), self.state, imgui.MouseButton_
        moved = io.mouse_delta.x != 0 or io.mouse_delta.y != 0
        state.still_s = 0.0 if moved else state.still_s + io.delta_time
        if io.want_capture_mouse or not imgui.is_mouse_pos_valid():
            return
        dx, dy = io.mouse_delta.x, io.mouse_delta.y
        across = -1.0 if state.mirror else 1.0
        if imgui.is_mouse_double_clicked(button.left):
            self.perform("recentre")
        elif imgui.is_mouse_dragging(button.left, 0.0):
            yaw, pitch = -across * dx * DEGREES_PER_PX, dy * DEGREES_PER_PX
            state.orbit = state.orbit.turned(yaw, pitch)
        elif imgui.is_mouse_dragging(button.right, 0.0):
            size = state.orbit.mm_per_px(int(view.width), int(view.height))
            state.orbit = state.orbit.moved(across * dx * size, -dy * size)
        if io.mouse_wheel:
            state.orbit = state.orbit.zoomed(ZOOM_PER_STEP**io.mouse_wheel)

    def _save_picture(self) -> None:
        from PIL import Image

        state = self.state
        shown = state.motion.at(time.monotonic_ns()) or REST
        picture = self._head.still(*shown, state.orbit)
        if state.mirror:
            picture = picture[:, ::-1]
        path = free_name(Path.cwd(), state.label)
        try:
            with files.replacing(path, private=True, durable=False) as draft:
                Image.fromarray(picture).save(draft)
            state.say(f"Saved {path.name} in {path.parent}")
        except OSError as error:
            state.say(f"No picture: {error.strerror or error}")


def free_name(folder: Path, avatar: str) -> Path:
    """livedrive-AVATAR-001.png, or the first number after it that is not taken; an avatar may be a
    file."""
    number = 1
    while (path := folder / f"livedrive-{Path(avatar).name}-{number:03d}.png").exists():
        number += 1
    return path
