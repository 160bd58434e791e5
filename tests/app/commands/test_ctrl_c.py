"""Ctrl-C ends a command in one line and with status 130, also while it is still starting."""

import json
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from llvmlite.binding import ffi

from app import main
from app.command_line import run
from app.drive.sink import FrameResult
from app.sinks.progress import ProgressSink

ROOT = Path(__file__).parents[3]
CODE = """
import os, signal, sys
module, ignored, sent, *words = sys.argv[1:]

class CtrlC:
    def find_spec(self, name, *_):
        if name == module:
            sys.meta_path.remove(self)
            os.kill(os.getpid(), getattr(signal, sent))

sys.meta_path.insert(0, CtrlC())
# as Python starts in a terminal, even where these tests were started with an &
signal.signal(signal.SIGINT, signal.SIG_IGN if ignored else signal.default_int_handler)
sys.argv[1:] = words
from app.main import main
main()
"""


def avatars(
    module: str, *words: str, ignored: bool = False, sent: str = "SIGINT"
) -> "subprocess.CompletedProcess[str]":
    """`livedrive avatar list`, or with other words, which gets Ctrl-C, or another signal, when it
    imports `module`."""
    ignores = "yes" if ignored else ""
    words = words or ("list",)
    return subprocess.run(
        [sys.executable, "-c", CODE, module, ignores, sent, "avatar", *words],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
    )


@pytest.mark.parametrize(
    "module", ["tyro", "numpy", "numpy._core.getlimits", "sensors.types", "app.commands.train"]
)
def test_ctrl_c_while_starting_is_one_line(module: str) -> None:
    """Red before: tracebacks of imports in the first half second, and other statuses."""
    done = avatars(module)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "livedrive: stopped\n")


def test_ctrl_c_that_is_ignored_stays_ignored() -> None:
    """As under `nohup`, or behind an & of a script."""
    done = avatars("numpy", ignored=True)
    assert done.returncode == 0 and "ben" in done.stdout, done.stderr


@pytest.mark.skipif(sys.platform == "win32", reason="a kill there cannot be caught")
@pytest.mark.parametrize("sent", ["SIGTERM", "SIGHUP"])
def test_a_kill_ends_as_ctrl_c_does(sent: str, tmp_path: Path) -> None:
    """So that drafts are removed and files are finished. Red before: it died on the spot."""
    show = "show", "ada", "--picture", str(tmp_path / "ada.png")
    done = avatars("render.decoder.decoder", *show, sent=sent)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "livedrive: stopped\n")


def test_a_replay_that_ctrl_c_ends_has_its_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Red before: no report, and no word of the files that it had finished."""

    def on_frame(_: object, result: FrameResult) -> None:
        if result.driven.index == 7:
            raise KeyboardInterrupt

    monkeypatch.setattr(ProgressSink, "on_frame", on_frame)
    made = [tmp_path / "out.csv", tmp_path / "out.json"]
    words = ["replay", str(ROOT / "recordings" / "smoke"), "--size", "64", "--gaussians", "16k"]
    with pytest.raises(SystemExit) as ended:
        run([*words, "--arkit", str(made[0]), "--report", str(made[1])])
    told = capsys.readouterr()
    assert ended.value.code == 130 and told.err.endswith("livedrive: stopped\n")
    assert all(f"wrote {path}" in told.out for path in made)
    assert json.loads(made[1].read_text())["frames"] == 8


def test_ctrl_c_leaves_no_lock_of_numba_taken() -> None:
    """Red before: `avatar turn` hung, its helper waiting for the lock to load a loop."""
    sent: list[None] = []
    lock: Any = ffi.lib._lock  # noqa: SLF001

    def on_lock() -> None:
        if not sent:
            sent.append(signal.raise_signal(signal.SIGINT))

    def nothing() -> None: ...

    def is_free() -> bool:
        return lock._lock.acquire(timeout=1) and not lock._lock.release()  # noqa: SLF001

    lock.register(on_lock, nothing)
    try:
        with pytest.raises(KeyboardInterrupt), main._ends_as_on_ctrl_c():  # noqa: SLF001
            with lock:
                pass
            time.sleep(5)
        with ThreadPoolExecutor(1) as helper:
            assert helper.submit(is_free).result()
    finally:
        lock.unregister(on_lock, nothing)
