"""A bench whose part has died is not passed. Red before: it was, or it ended in a traceback."""

import json
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from app.bench.network.load import LoadSink
from app.bench.sensors import soak
from app.bench.sensors.probe import SoakProbe, watched_growth
from app.bench.xr import ticks
from app.drive.sink import FrameResult, RunInfo
from app.drive.stages import Stages
from encoder.types import DrivenFrame
from render.types import AHEAD
from sensors.types import FPS, SensorFrame

ROOT = Path(__file__).parents[3]


def result(index: int) -> FrameResult:
    silence, ages = np.zeros(1600, np.float32), np.full(2, -1, np.int64)
    heard = SensorFrame(index, 0, silence, None, np.zeros(2, bool), ages, False)
    return FrameResult(heard, DrivenFrame(index, 0, np.zeros(256, np.float32), AHEAD), None)


@pytest.mark.parametrize("lives", [True, False])
def test_a_soak_misses_a_process_that_has_ended(lives: bool) -> None:
    child = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    probe = SoakProbe(10.0)
    for index in range(10 * FPS):
        probe.on_frame(result(index))
        if index == probe.warm and not lives:
            child.kill()
            child.wait()
    child.communicate(b"\n")
    names = ("missed_ticks_percent", "audio_drift_ms", "threads_leaked", "codes_unlike_the_replay")
    metrics = dict.fromkeys((*names, "sound_to_code_p95_ms"), 0.0)
    metrics |= {"page_messages": 9, "head_valid_share": 1.0, "eyes_valid_share": 0.4}
    metrics |= watched_growth(probe)
    metrics.pop("app.web_memory_mb_growth", None)  # of the page that other tests share
    missed = {row["name"] for row in soak.thresholds(metrics) if not row["ok"]}
    absent = {"app.web_memory_mb_growth", "app.window_memory_mb_growth"}  # not watched
    absent |= {"eyes_valid_share"}  # a camera
    assert missed == absent | (set() if lives else {"children_growth"})


def test_hostile_clients_that_do_not_run_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    link = SimpleNamespace(status={"addresses": ["http://127.0.0.1:9/"]})
    report = {"page": {"refused": 0}}
    server: Any = SimpleNamespace(link=link, network_report=lambda: report)
    load = LoadSink(server, Stages())
    monkeypatch.setattr("app.bench.network.load.SPELL_S", 0.1)
    monkeypatch.chdir(ROOT)
    load.on_start(RunInfo(512, 512, 1))
    assert load._clients
    load.on_frame(result(3))  # nobody listens there
    load._clients.wait(60)
    load.on_frame(result(9))  # the next spell; red before: a broken pipe
    load.close()
    assert load.died


def test_a_receiver_without_a_json_frame_says_so() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "app.bench.network.receivers"],
        input="http://127.0.0.1:9/json\nend\n", cwd=ROOT, capture_output=True, text=True,
        check=True,
    )  # fmt: skip
    told = json.loads(done.stdout.splitlines()[-1])
    assert told == {"datagrams": [0, 0, 0], "first": 0, "frames": 0}


def test_what_one_round_drops_is_in_no_median(monkeypatch: pytest.MonkeyPatch) -> None:
    rounds = [{"dropped": drops, "crashes": drops // 5} for drops in (0, 0, 0, 0, 5, 0, 0, 0, 0)]
    rest = {"tick_p50_ms": 9.0, "tick_p99_ms": 9.0, "fps": 90.0, "share": 1.0}
    replays = iter(rounds)
    monkeypatch.setattr(ticks, "_replay", lambda *_, **__: next(replays) | rest)
    _, thresholds = ticks.measure_ticks(Path("s"), "ben")
    assert {row["name"] for row in thresholds if not row["ok"]} == {"on_dropped", "on_crashes"}
