"""The soak of `bench`, short: what it finds does not depend on speed."""

import random
import threading
from pathlib import Path

import pytest

from app.bench.sensors import fault_kinds, fault_watch
from app.bench.sensors.soak import measure_soak
from app.sinks.dashboard import Dashboard, meter
from app.sinks.live_stats import LiveStats
from sensors.cameras.spec import cameras
from sensors.clock import ManualClock
from sensors.live.source import LiveSource
from sensors.standins import mjpeg

pytestmark = pytest.mark.slow


def test_a_short_soak_gives_the_codes_of_its_own_replay(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(Path(__file__).parents[3])
    report = measure_soak(0.09)  # what grows is looked at after 5 s
    metrics = report["metrics"]
    assert metrics["frames"] >= 157
    assert metrics["codes_unlike_the_replay"] == 0
    assert metrics["threads_leaked"] == 0
    assert metrics["eyes_valid_share"] > 0 and metrics["head_valid_share"] > 0
    assert metrics["page_messages"] > 10 and metrics["recording_problem"] == ""
    assert {bar["name"] for bar in report["bars"]} >= {"missed_ticks_percent", "memory_mb_growth"}
    growth = [bar for bar in report["bars"] if bar["name"].endswith("_growth")]
    assert all(abs(bar["value"]) < 1e6 for bar in growth)  # measured, whatever it is


def test_a_camera_that_never_gives_a_picture_is_a_hang(monkeypatch: pytest.MonkeyPatch) -> None:
    """Red before: `bench faults` waited for its first picture for ever."""
    monkeypatch.setattr(fault_watch, "HANG_S", 0.2)
    monkeypatch.setattr(fault_kinds, "STOP_S", 0.0)
    monkeypatch.setattr(mjpeg.MjpegServer, "payload", lambda *_: b"")
    rows = list[fault_watch.Fault]()
    work = (1, random.Random(0), rows)
    bench = threading.Thread(target=fault_kinds.stopped, args=work, daemon=True)
    bench.start()
    bench.join(30)
    assert not bench.is_alive() and [row.hangs for row in rows] == [1]


def test_the_dashboard_shows_every_sensor() -> None:
    from rich.console import Console

    clock = ManualClock()
    source = LiveSource(None, cameras(["http://127.0.0.1:9/"], clock), clock)
    console = Console(width=120, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
    console.print(Dashboard(source, LiveStats()).render())
    shown = console.export_text()
    assert "microphone" in shown
    assert "eye left + right" in shown
    assert meter(-200).count("·") == 20
    assert meter(0).count("█") == 20
