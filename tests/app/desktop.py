"""A screen for the window tests: Xvfb, with a hand that points and types through XTEST."""

import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

PATIENCE_S = 60.0  # the machine may be busy


class Desktop:
    """One virtual screen; windows lie at its upper left corner, as there is no window manager."""

    def __init__(self, name: str) -> None:
        from Xlib import display

        self.name = name
        self._display = display.Display(name)

    def screenshot(self) -> NDArray[np.uint8]:
        """[H, W, 3]"""
        from PIL import ImageGrab

        return np.asarray(ImageGrab.grab(xdisplay=self.name).convert("RGB"))

    def point(self, x: float, y: float) -> None:
        from Xlib import X
        from Xlib.ext import xtest

        xtest.fake_input(self._display, X.MotionNotify, x=round(x), y=round(y))
        self._display.sync()

    def press(self) -> None:
        self._button(True)

    def release(self) -> None:
        self._button(False)

    def key(self, name: str) -> None:
        """Type one key, by its X11 name."""
        from Xlib import XK, X
        from Xlib.ext import xtest

        code = self._display.keysym_to_keycode(XK.string_to_keysym(name))
        for event in (X.KeyPress, X.KeyRelease):
            xtest.fake_input(self._display, event, code)
            self._display.sync()
            time.sleep(0.15)

    def close_window(self, title: str) -> None:
        """What a click on a title bar's cross does."""
        from Xlib import X
        from Xlib.protocol import event

        atom = self._display.intern_atom
        for window in self._display.screen().root.query_tree().children:
            if title in (window.get_wm_name() or ""):
                data = (32, [atom("WM_DELETE_WINDOW"), X.CurrentTime, 0, 0, 0])
                window.send_event(
                    event.ClientMessage(window=window, client_type=atom("WM_PROTOCOLS"), data=data)
                )
        self._display.sync()

    def _button(self, down: bool) -> None:
        from Xlib import X
        from Xlib.ext import xtest

        xtest.fake_input(self._display, X.ButtonPress if down else X.ButtonRelease, 1)
        self._display.sync()


@contextmanager
def open_desktop(width: int = 1280, height: int = 800) -> Iterator[Desktop]:
    """Start Xvfb on a free display number."""
    command = [
        "Xvfb",
        "-displayfd",
        "1",
        "-screen",
        "0",
        f"{width}x{height}x24",
        "-nolisten",
        "tcp",
    ]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as server:
        try:
            assert server.stdout is not None
            yield Desktop(f":{server.stdout.readline().decode().strip()}")
        finally:
            server.terminate()


def wait_for(what: Callable[[], object]) -> None:
    """Return when `what()` is true; fail when it does not become so."""
    deadline = time.monotonic() + PATIENCE_S
    while not what():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.02)
