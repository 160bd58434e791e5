"""The headset's process: ticks in, poses out, whatever happens to the runtime or to itself."""

import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from desktop import wait_for

from app.drive.sink import FrameResult, RunInfo
from app.sinks.sensor_notes import SensorNotes
from app.terminal.compiling import WORDS
from app.xr.headset import xr_head
from app.xr.link import Mode, XrInfo
from app.xr.sink import XrSink
from encoder.types import DrivenFrame
from render.types import AHEAD
from sensors.assemble import Assembler
from sensors.clock import MonotonicClock
from sensors.live.recorder import LiveRecorder
from sensors.live.source import LiveSource
from sensors.session.recording import Recording
from sensors.types import FPS, NS, SensorFrame

pytestmark = pytest.mark.slow
ROOT = Path(__file__).parents[3]


def result(index: int) -> FrameResult:
    t_ns, ages = (index + 1) * NS // FPS, np.zeros(2, np.int64)
    frame = SensorFrame(
        index, t_ns, np.zeros(1600, np.float32), None, np.zeros(2, bool), ages, False
    )
    return FrameResult(frame, DrivenFrame(index, t_ns, np.zeros(256, np.float32), AHEAD), None)


class Worn:
    """A headset's process, and the file that is there while its runtime is."""

    def __init__(self, path: Path, mode: Mode) -> None:
        self.path, self.told = path, list[str]()
        path.touch()
        info = XrInfo(mode, "ben", gaussians="16k", standin=str(path))
        self.sink = XrSink(info, MonotonicClock(), self.told.append)
        self.sink.on_start(RunInfo(64, 64, None))
        self.status, self.index = self.sink.memory.status, 0

    def tick(self, count: int = 1) -> None:
        for _ in range(count):
            self.sink.on_frame(result(self.index))
            self.index += 1

    def more(self, field: str, count: int = 3) -> None:
        """Wait until it has counted further."""
        target = self.status[field] + count
        wait_for(lambda: self.status[field] >= target)


@pytest.fixture
def worn(tmp_path: Path) -> Iterator[Worn]:
    made = Worn(tmp_path / "runtime", "auto")
    yield made
    made.sink.close()


@pytest.fixture
def headless(tmp_path: Path) -> Iterator[Worn]:
    made = Worn(tmp_path / "runtime", "headless")
    yield made
    made.sink.close()


def test_a_runtime_that_goes_or_a_process_that_stops_costs_no_tick(worn: Worn) -> None:
    worn.tick(3)
    worn.more("frames")
    worn.path.unlink()
    wait_for(lambda: worn.status["problem"])
    worn.tick(3000)  # 100 s of ticks: any queue or pipe would be full long ago
    frames = int(worn.status["frames"])
    worn.path.touch()
    wait_for(lambda: worn.status["frames"] > frames)
    worn.tick(3)
    assert worn.told == ["headset: the runtime has gone; still looking for it", "headset: is back"]
    report = worn.sink.xr_report()
    assert report["losses"] == 1 and report["crashes"] == 0 and report["eye_px"] == [64, 64]
    os.kill(worn.sink.pid, signal.SIGSTOP)
    try:
        worn.tick(3000)
    finally:
        os.kill(worn.sink.pid, signal.SIGCONT)
    worn.more("frames")


def test_a_change_of_avatar_crosses(worn: Worn) -> None:
    assert worn.sink.memory.text("avatar") == "ben" and worn.sink.picks() == {}
    worn.sink.show({"avatar": "femi"})
    worn.sink.show({"muted": True})
    assert worn.sink.memory.text("avatar") == "femi"


def test_a_crashed_process_is_started_again(headless: Worn) -> None:
    os.kill(headless.sink.pid, signal.SIGKILL)
    wait_for(lambda: headless.status["problem"])
    headless.tick(2)
    headless.more("poses")
    headless.tick(2)
    assert [line.split(";")[0] for line in headless.told] == [
        "headset: its process crashed",
        "headset: is back",
    ]


def test_poses_are_recorded_into_a_session_that_replays(headless: Worn, tmp_path: Path) -> None:
    clock, told = MonotonicClock(), list[str]()
    head = xr_head(headless.sink.memory, clock, told.append)
    source = LiveSource(None, (), clock, head=head)
    recorder = LiveRecorder(
        tmp_path / "session", created="now", devices=source.info.devices, tell=told.append
    )
    live, seen = Assembler(), list[SensorFrame]()
    source.open()

    def ten_turned() -> bool:
        for packet in source.poll():
            recorder.append(packet)
            live.push(packet)
        seen.extend(live.ready())
        return sum(frame.head_valid for frame in seen) >= 10

    wait_for(ten_turned)
    source.close()
    recorder.close()
    assert not told
    again = Assembler()
    with Recording(tmp_path / "session") as recording:
        assert recording.info.devices["head"] == "xr" and len(recording.heads) >= 15
        for entry in recording.entries:
            packet = recording.packet(entry)
            assert packet is not None
            again.push(packet)
    replayed = [(f.t_ns, f.head, f.head_valid, f.head_age_ns) for f in again.ready()]
    assert replayed == [(f.t_ns, f.head, f.head_valid, f.head_age_ns) for f in seen]


def test_a_lost_headset_is_told_as_a_lost_tracker(headless: Worn) -> None:
    clock, told = MonotonicClock(), list[str]()
    head = xr_head(headless.sink.memory, clock, told.append)
    source = LiveSource(None, (), clock, head=head)
    source.open()
    wait_for(lambda: source.poll() and not head.problem)
    headless.path.unlink()
    wait_for(lambda: source.poll() is not None and head.problem == "lost")
    notes = SensorNotes(source, told.append)
    notes.close()
    assert told == ["xr: lost"]
    headless.path.touch()
    wait_for(lambda: source.poll() and not head.problem)
    source.close()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["run", "--xr"], "active OpenXR runtime"),
        (["run", "--xr", "headless"], "active OpenXR runtime"),
        (["run", "--head", "xr"], "try run --xr headless"),
        (["record", "nowhere", "--xr"], "active OpenXR runtime"),
        (["record", "nowhere", "--head", "xr"], "record --xr"),
        (["record", "nowhere", "--xr", "--head", "vmc://:39539"], "expected one tracker"),
        (["run", "--xr", "auto", "headless"], "give one"),
        (["replay", "recordings/smoke", "--fast", "--xr"], "--fast or --xr"),
    ],
)
def test_what_cannot_be_is_one_line(
    words: list[str], said: str, livedrive: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    monkeypatch.setenv("XR_RUNTIME_JSON", "/nowhere/runtime.json")
    if words[0] != "replay":
        words = [*words, "--mic", "none", "--seconds", "1"]
    if words[0] == "run":
        words = [*words, "--headless"]
    done = livedrive(*words)
    lines = [x for x in done.stderr.splitlines() if WORDS not in x]  # that of a first run
    assert done.returncode == 2 and len(lines) == 1 and said in lines[0]


def test_without_pyopenxr_the_next_command_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    from app.xr.runtimes.openxr import OpenXrRuntime
    from app.xr.runtimes.protocol import NoRuntimeError

    monkeypatch.setitem(sys.modules, "xr", None)
    with pytest.raises(NoRuntimeError, match=r"pip install livedrive\[xr\]"):
        OpenXrRuntime(False, MonotonicClock()).open()
