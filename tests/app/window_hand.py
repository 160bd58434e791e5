"""Somebody in front of an open window, for its tests."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from desktop import Desktop, wait_for

from app.drive.sink import FrameResult, RunInfo
from app.drive.stages import STAGES
from app.window.sink import WindowSink
from app.window.state.layout import SIZE, arrange, toolbar_button
from app.window.state.shared import WindowInfo
from encoder.types import DrivenFrame
from render.types import AHEAD
from sensors.clock import MonotonicClock
from sensors.types import FPS, NS, SensorFrame

BUTTONS = ("mute", "record", "recentre", "picture", "mirror", "full_screen", "panels", "help")


def result(index: int) -> FrameResult:
    sound = np.full(1600, 0.25, np.float32)
    eyes = np.full((2, 400, 400), 200, np.uint8)
    ages, t_ns = np.zeros(2, np.int64), (index + 1) * NS // FPS
    frame = SensorFrame(index, t_ns, sound, eyes, np.ones(2, bool), ages, False)
    driven = DrivenFrame(index, t_ns, np.zeros(256, np.float32), AHEAD)
    return FrameResult(frame, driven, None, dropped=3)


class Hand:
    """An open window with someone in front of it."""

    def __init__(self, desktop: Desktop, sink: WindowSink, folder: Path) -> None:
        self.desktop, self.sink, self.folder, self.posted = desktop, sink, folder, 0

    def begin(self) -> None:
        """As it was when it opened."""
        self.sink.show({"avatar": "ben", "emotion": None, "muted": False})
        self.desktop.key("c")
        self.tick()
        self.settle()
        self.sink.picks()

    def tick(self, count: int = 1) -> None:
        for _ in range(count):
            self.sink.on_frame(result(self.posted))
            self.posted += 1

    def settle(self) -> None:
        """Wait until the window has shown three more pictures."""
        target = self.memory("frames") + 3
        wait_for(lambda: self.memory("frames") >= target)

    def memory(self, field: str) -> int:
        return int(self.sink._memory.controls[field])  # noqa: SLF001

    def click(self, button: str) -> None:
        bar = arrange(*SIZE, 1.0, True, len(BUTTONS)).toolbar
        area = toolbar_button(bar, BUTTONS.index(button), 1.0)
        self.desktop.click(area.x + area.width / 2, area.y + area.height / 2)


@contextmanager
def open_window(desktop: Desktop, folder: Path) -> Iterator[Hand]:
    info = WindowInfo(
        title="test",
        avatar="ben",
        avatars=("ada", "ben", "kofi"),
        emotions=("happy", "bored"),
        can_record=True,
        live=True,
        size=128,
        gaussians="16k",
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DISPLAY", desktop.name)
        patch.delenv("WAYLAND_DISPLAY", raising=False)
        patch.chdir(folder)
        sink = WindowSink(info, MonotonicClock(), lambda: [1.0] * len(STAGES))
        sink.on_start(RunInfo(512, 512, None))
    made = Hand(desktop, sink, folder)
    made.tick()
    made.settle()
    yield made
    sink.close()
