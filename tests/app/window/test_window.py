"""The window on a virtual screen: it shows, obeys clicks and keys, and never holds up a tick."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from desktop import Desktop, open_desktop, wait_for

from app.drive.sink import FrameResult, RunInfo
from app.drive.stages import STAGES
from app.drive.tape import Tape
from app.window.sink import WindowSink
from app.window.state.layout import SIZE, arrange, toolbar_button
from app.window.state.shared import WindowInfo
from encoder.types import DrivenFrame
from render.types import AHEAD
from sensors.clock import MonotonicClock
from sensors.types import FPS, NS, InputError, SensorFrame

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[3]
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

    def __init__(self, desktop: Desktop, sink: WindowSink) -> None:
        self.desktop, self.sink, self.posted = desktop, sink, 0

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
        self.click_at(area.x + area.width / 2, area.y + area.height / 2)

    def click_at(self, x: float, y: float) -> None:
        """Each movement in pictures of its own: those of a busy machine take longer than a hand,
        and a list is hit only once it has been shown."""
        self.desktop.point(x, y)
        self.settle()
        self.desktop.press()
        self.settle()
        self.desktop.release()
        self.settle()


@pytest.fixture(scope="module")
def desktop() -> Iterator[Desktop]:
    with open_desktop(*SIZE) as made:
        yield made


@pytest.fixture
def hand(desktop: Desktop, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Hand]:
    monkeypatch.setenv("DISPLAY", desktop.name)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.chdir(tmp_path)
    info = WindowInfo(
        title="test",
        avatar="ben",
        avatars=("ada", "ben", "kofi"),
        emotions=("happy", "bored"),
        can_record=True,
        live=True,
        size=128,
    )
    sink = WindowSink(info, MonotonicClock(), lambda: [1.0] * len(STAGES))
    sink.on_start(RunInfo(512, 512, None))
    made = Hand(desktop, sink)
    made.tick()
    made.settle()
    yield made
    sink.close()


def test_it_shows_the_head_and_obeys_clicks_and_keys(hand: Hand, tmp_path: Path) -> None:
    from PIL import Image

    desktop, read = hand.desktop, hand.sink.read
    wait_for(lambda: hand.memory("shown") == 0)
    hand.settle()
    picture = desktop.screenshot().astype(int)
    forehead, corner = picture[260, 466], picture[400, 30]
    assert forehead[0] > forehead[2] + 30 and corner.max() < 60  # skin before a dark background
    assert picture[:, 940:].std() > 10  # the sidebar holds things

    assert not read().muted
    hand.click("mute")
    wait_for(lambda: read().muted)
    desktop.key("m")
    wait_for(lambda: not read().muted)
    hand.click("record")
    wait_for(lambda: read().recording)
    desktop.key("c")
    wait_for(lambda: read().recentred == 1)
    desktop.key("BackSpace")
    wait_for(lambda: read().resets == 1)

    for key in ("F11", "F11", "Tab", "Tab", "x", "b", "s"):
        desktop.key(key)
        hand.settle()  # still alive
    before = desktop.screenshot()[300:500, 300:600].astype(int)
    desktop.key("F1")
    hand.settle()
    help_page = desktop.screenshot()[300:500, 300:600]
    assert np.abs(help_page - before).mean() > 20
    desktop.key("Escape")

    desktop.key("p")
    saved = tmp_path / "livedrive-ben-001.png"
    wait_for(saved.exists)
    hand.settle()
    still = np.asarray(Image.open(saved))
    assert still.shape == (1024, 1024, 4)
    assert still[0, 0, 3] == 0 and still[500, 512, 3] == 255


def test_another_avatar_and_emotion_are_picked_from_their_lists(hand: Hand) -> None:
    assert hand.sink.read().avatar == "ben" and hand.sink.read().emotion is None
    hand.click_at(1000, 54)  # the lists drop down: 24 px a row
    hand.click_at(1000, 143)
    wait_for(lambda: hand.sink.read().avatar == "kofi")
    hand.click_at(1200, 54)
    hand.click_at(1150, 119)
    wait_for(lambda: hand.sink.read().emotion == "happy")


def test_it_shows_what_was_changed_elsewhere(hand: Hand) -> None:
    """Red before: it showed, and went on asking for, what had been picked in it before."""
    hand.settle()
    before = hand.desktop.screenshot()[40:80, 940:].astype(int)
    assert hand.sink.picks() == {}
    hand.sink.show({"avatar": "kofi", "emotion": "bored:0.7", "muted": True})
    hand.settle()
    after = hand.desktop.screenshot()[40:80, 940:]
    assert np.abs(after - before).mean() > 1 and hand.sink.picks() == {}
    hand.desktop.key("m")
    wait_for(lambda: hand.sink.picks() == {"muted": False})
    hand.sink.show({"emotion": "happy:0.5+bored:0.3"})
    hand.settle()
    assert hand.sink.picks() == {} and hand.sink.read().emotion == "happy:0.5+bored:0.3"
    hand.desktop.key("e")
    wait_for(lambda: hand.sink.picks() == {"emotion": None})


def test_dragging_turns_the_head(hand: Hand) -> None:
    before = hand.desktop.screenshot()[200:600, 200:700].astype(int)
    hand.desktop.point(400, 300)
    hand.settle()
    hand.desktop.press()
    hand.settle()
    hand.desktop.point(560, 300)
    hand.settle()
    hand.desktop.release()
    hand.settle()
    assert np.abs(hand.desktop.screenshot()[200:600, 200:700] - before).mean() > 5


def test_a_stopped_window_holds_up_no_tick(hand: Hand) -> None:
    process = hand.sink._process.pid  # noqa: SLF001
    os.kill(process, signal.SIGSTOP)
    try:
        hand.tick(3000)  # 100 s of ticks: any queue or pipe would be full long ago
    finally:
        os.kill(process, signal.SIGCONT)
    wait_for(lambda: hand.memory("shown") == 3000)


def test_a_failed_recording_takes_the_button_back(hand: Hand, tmp_path: Path) -> None:
    class Broken:
        problem = "No space left on device"

        def __init__(self, folder: Path) -> None: ...
        def append(self, packet: object) -> None: ...
        def close(self) -> None: ...

    hand.sink._tape = Tape(None, Broken)  # noqa: SLF001
    hand.click("record")
    wait_for(lambda: not hand.sink.read().recording and hand.sink._tape.sessions)  # noqa: SLF001
    hand.sink._tape.close()  # noqa: SLF001


def test_a_crashed_window_ends_nothing(hand: Hand, capsys: pytest.CaptureFixture[str]) -> None:
    os.kill(hand.sink._process.pid, signal.SIGKILL)  # noqa: SLF001
    hand.sink._process.wait()  # noqa: SLF001
    hand.tick(100)
    assert not hand.sink.read().closed and not hand.sink.read().closed
    assert capsys.readouterr().err.count("crashed") == 1  # red before: in what a script reads


def test_closing_the_window_ends_the_run(hand: Hand) -> None:
    hand.desktop.close_window("livedrive")
    wait_for(lambda: hand.sink.read().closed)


def test_replay_in_a_window(desktop: Desktop) -> None:
    livedrive = str(Path(sys.executable).parent / "livedrive")
    done = subprocess.run(
        [livedrive, "replay", "recordings/smoke", "--window", "--size", "64"],
        cwd=ROOT,
        env=dict(os.environ, DISPLAY=desktop.name),
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0 and "90 frames" in done.stdout, done.stderr


def test_without_a_screen_one_line_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    sink = WindowSink(WindowInfo("x", "ben", ("ben",)), MonotonicClock(), list[float])
    with pytest.raises(InputError, match="xvfb-run"):
        sink.on_start(RunInfo(64, 64, None))
    sink.close()
