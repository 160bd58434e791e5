"""`livedrive bench soak`: a long live run with everything at once, and its own replay.

PulseAudio, two MJPEG servers with jitter and a VMC tracker -> a run with its window, its page and
somebody at it, datagrams to three programs, and a recording; then the recording is replayed and
must give the same codes. Only the picture of a second machine's browser is not drawn.
"""

import json
import subprocess
import sys
import threading
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import replace
from math import inf
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from app.bench.sensors import world
from app.bench.sensors.probe import SoakProbe, unlike, watched_growth
from app.drive.sink import FrameResult, RunInfo
from app.sinks.live_stats import LiveStats
from app.terminal.thresholds import at_least, at_most
from render.types import SHARED_DENSITY
from sensors.types import FPS

if TYPE_CHECKING:
    from app.compose.settings import DriveSettings
    from app.web.sink import WebSink

MAX_GROWTH_MB = 5.0
GROWTH, OWN = "{}memory_mb_growth", ("", "app.web_", "app.window_")  # processes of a run
WARM_RUN_S = 1.0


def measure_soak(minutes: float) -> dict[str, Any]:
    """The report holds metrics and thresholds."""
    from app.compose.settings import DriveSettings, NetworkSettings

    seconds = minutes * 60
    with TemporaryDirectory() as folder, world.screen(), _receivers() as urls:
        session = Path(folder) / "session"
        network = NetworkSettings(send=urls, web=0)
        settings = DriveSettings(
            gaussians=SHARED_DENSITY,
            realtime=True,
            window=True,
            condition="eyes",
            head="track",
            network=network,
        )
        with world.microphone() as mic, world.cameras(2) as eyes, world.tracker() as head:
            unseen = replace(settings, window=False)  # a window has no threads in this process
            _run(unseen, mic, eyes, head, Path(folder) / "warm", WARM_RUN_S)
            threads = threading.active_count()  # those of the libraries run by now
            metrics, live = _run(settings, mic, eyes, head, session, seconds)
            metrics["threads_leaked"] = threading.active_count() - threads
        size = sum(f.stat().st_size for f in session.iterdir())
        metrics["recorded_mb_a_minute"] = round(size / 2**20 / minutes, 1)
        replayed = _replay(session, seconds)
    metrics["codes_unlike_the_replay"] = unlike(live, replayed)
    metrics |= watched_growth(live)
    return {"metrics": metrics, "bars": thresholds(metrics)}


def thresholds(metrics: dict[str, Any]) -> list[dict[str, Any]]:
    """Growth that was not measured, as of a process that has ended, is a miss."""
    grown = {name: metrics.get(name, inf) for name in map(GROWTH.format, OWN)}
    return [
        at_most("missed_ticks_percent", metrics["missed_ticks_percent"], 0.1),
        at_most("audio_drift_ms_abs", abs(metrics["audio_drift_ms"]), 1.0),
        *(at_most(name, value, MAX_GROWTH_MB) for name, value in grown.items()),
        at_most("descriptors_growth", metrics.get("descriptors_growth", inf), 0),
        at_least("children_growth", metrics.get("children_growth", -inf), 0),
        at_most("threads_leaked", metrics["threads_leaked"], 0),
        at_most("codes_unlike_the_replay", metrics["codes_unlike_the_replay"], 0),
        at_most("sound_to_code_p95_ms", metrics["sound_to_code_p95_ms"], 45.0),
        at_least("page_messages", metrics["page_messages"], 1),
        at_least("head_valid_share", metrics["head_valid_share"], 0.9),
        at_least("eyes_valid_share", metrics["eyes_valid_share"], 0.9),
    ]


class HeadShare:
    """A sink: in how many frames a tracked head was there."""

    def __init__(self) -> None:
        self.frames = self.seen = 0

    def on_start(self, info: RunInfo) -> None: ...

    def on_frame(self, result: FrameResult) -> None:
        self.frames += 1
        self.seen += result.sensors.head is not None

    def close(self) -> None: ...


class PageVisitor:
    """A sink: opens the page as soon as there is one, and stays."""

    def __init__(self, page: "WebSink") -> None:
        self._page = page
        words = [sys.executable, "-m", "app.bench.sensors.visitors", "page"]
        self._process = subprocess.Popen(words, stdin=subprocess.PIPE, text=True)

    def on_start(self, info: RunInfo) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(self._page.link.status["addresses"][0] + "\n")
        self._process.stdin.flush()

    def on_frame(self, result: FrameResult) -> None: ...

    def close(self) -> None:
        self._process.terminate()
        self._process.wait()


def _run(
    settings: "DriveSettings", mic: str, eyes: list[str], head: str, session: Path, seconds: float
) -> tuple[dict[str, Any], SoakProbe]:
    """As `livedrive run` does it."""
    from app.compose.build import build, load_driver
    from app.compose.live import live_source, open_page, open_recorder
    from app.compose.settings import HEAD_MODE, LiveSettings
    from app.drive.loop import drive
    from app.drive.tape import Tape
    from sensors.clock import MonotonicClock

    clock, stats, probe, share = MonotonicClock(), LiveStats(), SoakProbe(seconds), HeadShare()
    page = open_page(settings, clock)
    assert page is not None
    live = LiveSettings(mic=mic, eyes=tuple(eyes), head=head, seconds=seconds)
    source = live_source(live, clock, page)
    known = {HEAD_MODE: settings.head}
    tape = Tape(session, lambda folder: open_recorder(folder, source, known))
    try:
        parts = build(
            settings,
            source=source,
            driver=load_driver(settings, True),
            clock=clock,
            sinks=[stats, probe, share],
            tape=tape,
            page=page,
        )
        # a visitor can only come to a page that is there: after all other sinks
        summary = drive(replace(parts, sinks=[*parts.sinks, PageVisitor(page)]))
    finally:
        tape.close()
    told, network = stats.report(), page.network_report()["page"]
    metrics: dict[str, Any] = {
        "frames": summary.frames,
        "minutes": round(summary.frames / FPS / 60, 2),
        "missed_ticks_percent": 100 * summary.dropped / max(summary.frames, 1),
        "worst_late_ms": round(summary.late_ns / 1e6, 1),
        "frames_with_gap_after_warm_up": probe.gaps,
        "audio_drift_ms": round(probe.drift_ms, 3),
        "eyes_valid_share": min(told["eye_left_valid"], told["eye_right_valid"]),
        "head_valid_share": round(share.seen / max(share.frames, 1), 3),
        "page_messages": network["sent"],
        "recording_problem": tape.problem,
    }
    for name, value in parts.stages.summary()["tick"].items():
        metrics[f"tick_{name}"] = value
    for stream in ("sound", "eye_left", "eye_right"):
        for name, value in told[f"{stream}_to_code"].items():
            metrics[f"{stream}_to_code_{name}"] = value
    return metrics, probe


def _replay(session: Path, seconds: float) -> SoakProbe:
    from app.compose.replay import replay
    from app.compose.settings import DriveSettings

    probe = SoakProbe(seconds)
    replay(session, DriveSettings(condition="eyes"), [probe])
    return probe


@contextmanager
def _receivers() -> Generator[tuple[str, ...]]:
    """Three programs that take datagrams."""
    words = [sys.executable, "-m", "app.bench.network.receivers"]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as ends:
        assert ends.stdout is not None
        ports = json.loads(ends.stdout.readline())
        try:
            schemes = ("vmc", "vrchat", "livelink")
            yield tuple(f"{s}://127.0.0.1:{p}" for s, p in zip(schemes, ports, strict=True))
        finally:
            ends.kill()
