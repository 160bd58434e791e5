"""The end of a window: closed, crashed, with the session it shows, or for want of a screen."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from desktop import Desktop, wait_for
from window_hand import Hand, open_window

from app.drive.sink import RunInfo
from app.window.sink import WindowSink
from app.window.state.shared import WindowInfo
from sensors.clock import MonotonicClock
from sensors.types import InputError

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[3]


@pytest.fixture
def last(desktop: Desktop, tmp_path: Path) -> Iterator[Hand]:
    """A window of its own, for a test that ends it."""
    with open_window(desktop, tmp_path) as made:
        yield made


def test_a_crashed_window_ends_nothing(last: Hand, capsys: pytest.CaptureFixture[str]) -> None:
    os.kill(last.sink._process.pid, signal.SIGKILL)  # noqa: SLF001
    last.sink._process.wait()  # noqa: SLF001
    last.tick(100)
    assert not last.sink.read().closed and not last.sink.read().closed
    assert capsys.readouterr().err.count("crashed") == 1  # red before: in what a script reads


def test_closing_the_window_ends_the_run(last: Hand) -> None:
    last.desktop.close_window("livedrive")
    wait_for(lambda: last.sink.read().closed)


def test_replay_in_a_window(desktop: Desktop) -> None:
    livedrive = str(Path(sys.executable).parent / "livedrive")
    done = subprocess.run(
        [livedrive, "replay", "recordings/smoke", "--window", "--size", "64", "--gaussians", "16k"],
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
