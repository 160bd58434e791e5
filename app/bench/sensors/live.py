"""`livedrive bench soak` and `bench sensors`: a long live run, what it costs, and its own replay.

The whole path but the picture: PulseAudio and two MJPEG servers with jitter -> sensors -> codes,
recorded at the same time; then the recording is replayed and must give the same codes.
"""

import hashlib
import os
import threading
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from app.drive.sink import FrameResult, RunInfo
from app.sinks.live_stats import LiveStats
from app.terminal.thresholds import at_most
from sensors.types import FPS, NS

WARM_UP_S = 60.0  # at most; buffers are touched, the envelope of the clock settles
RECORD_S = 20.0


class SoakProbe:
    """A sink: a digest of every code, and memory and time after the warm-up."""

    def __init__(self, seconds: float) -> None:
        import psutil

        self.digests = np.ones(int(seconds * FPS) + 10 * FPS, np.uint64)
        self.frames = self.gaps = 0
        self._process = psutil.Process(os.getpid())
        self._warm = int(min(WARM_UP_S, seconds / 2) * FPS)
        self._start_mb, self._start_ns = 0.0, 0
        self.growth_mb = self.drift_ms = 0.0

    def on_start(self, info: RunInfo) -> None:
        pass

    def on_frame(self, result: FrameResult) -> None:
        driven = result.driven
        code = driven.expression.tobytes() + driven.gaze.tobytes()
        digest = hashlib.blake2b(code, digest_size=8).digest()
        self.digests[self.frames] = np.frombuffer(digest, np.uint64)[0]
        self.frames += 1
        if self.frames == self._warm:
            self._start_mb, self._start_ns = self._rss_mb(), result.sensors.t_ns
        if self.frames > self._warm:
            self.gaps += result.sensors.audio_gap
        if self.frames > self._warm and self.frames % FPS == 0:
            self.growth_mb = self._rss_mb() - self._start_mb
            counted_ns = (self.frames - self._warm) * NS // FPS
            self.drift_ms = (result.sensors.t_ns - self._start_ns - counted_ns) / 1e6

    def close(self) -> None:
        pass

    def _rss_mb(self) -> float:
        return self._process.memory_info().rss / 2**20


def measure_live_soak(minutes: float) -> dict[str, Any]:
    """The report holds metrics and thresholds."""
    from app.bench.sensors import world as bench_world
    from encoder.inference import load_driver

    driver, seconds = load_driver(device="cpu"), minutes * 60
    _drive_live(driver, None, [], None, 1.0)  # threads of the libraries start here
    threads = threading.active_count()
    with TemporaryDirectory() as folder:
        session = Path(folder) / "session"
        with bench_world.microphone() as mic, bench_world.cameras(2) as urls:
            metrics, live = _drive_live(driver, mic, urls, session, seconds)
        replayed = _replay(driver, session, seconds)
        metrics["recorded_mb_a_minute"] = round(
            sum(f.stat().st_size for f in session.iterdir()) / 2**20 / minutes, 1
        )
    frames = max(live.frames, replayed.frames)
    differing = int((live.digests[:frames] != replayed.digests[:frames]).sum())
    metrics["codes_unlike_the_replay"] = differing
    metrics["threads_leaked"] = threading.active_count() - threads
    thresholds = [
        at_most("missed_ticks_percent", metrics["missed_ticks_percent"], 0.1),
        at_most("audio_drift_ms_abs", abs(metrics["audio_drift_ms"]), 1.0),
        at_most("memory_growth_mb", metrics["memory_growth_mb"], 5.0),
        at_most("threads_leaked", metrics["threads_leaked"], 0),
        at_most("codes_unlike_the_replay", differing, 0),
        at_most("sound_to_code_p95_ms", metrics["sound_to_code_p95_ms"], 45.0),
    ]
    return {"metrics": metrics, "bars": thresholds}


def measure_sensors() -> dict[str, Any]:
    """Delay of each sensor, and what recording costs."""
    import psutil

    from app.bench.sensors import world as bench_world
    from app.compose.live import open_recorder
    from encoder.inference import load_driver
    from sensors.audio.microphone import Microphone
    from sensors.cameras.spec import cameras
    from sensors.clock import MonotonicClock
    from sensors.live.source import LiveSource

    driver, metrics = load_driver(device="cpu"), dict[str, Any]()
    process, clock = psutil.Process(os.getpid()), MonotonicClock()
    with bench_world.microphone() as mic, bench_world.cameras(2) as urls:
        metrics, _ = _drive_live(driver, mic, urls, None, RECORD_S)
        with TemporaryDirectory() as folder:
            microphone, (left, right) = Microphone(mic, clock), cameras(urls, clock)
            source = LiveSource(microphone, [left, right], clock, seconds=RECORD_S)
            recorder = open_recorder(Path(folder) / "session", source)
            delays: dict[str, list[float]] = {"microphone": [], "eye_left": [], "eye_right": []}
            source.open()
            start_ns, cpu = clock.now_ns(), sum(process.cpu_times()[:2])
            while not source.exhausted:
                for packet in source.poll():
                    recorder.append(packet)
                delays["microphone"].append(microphone.delay_ns / 1e6)
                delays["eye_left"].append(left.delay_ns / 1e6)
                delays["eye_right"].append(right.delay_ns / 1e6)
                clock.sleep_until_ns(clock.now_ns() + 4_000_000)
            source.close()
            recorder.close()
            used = sum(process.cpu_times()[:2]) - cpu
            metrics["record_cpu_percent"] = round(100 * used * NS / (clock.now_ns() - start_ns), 1)
    for name, values in delays.items():
        metrics[f"{name}_delay_p95_ms"] = round(float(np.percentile(values, 95)), 2)
    thresholds = [
        at_most("sound_to_code_p95_ms", metrics["sound_to_code_p95_ms"], 45.0),
        at_most("record_cpu_percent", metrics["record_cpu_percent"], 25.0),
    ]
    return {"metrics": metrics, "bars": thresholds}


def _drive_live(
    driver: Any, mic: str | None, urls: list[str], session: Path | None, seconds: float
) -> tuple[dict[str, Any], SoakProbe]:
    from app.compose.live import open_recorder
    from app.drive.loop import Drive, drive
    from app.drive.tape import Tape
    from sensors.audio.microphone import Microphone
    from sensors.cameras.spec import cameras
    from sensors.clock import MonotonicClock
    from sensors.live.source import LiveSource

    clock, stats, probe = MonotonicClock(), LiveStats(), SoakProbe(seconds)
    microphone = Microphone(mic, clock) if mic else None
    source = LiveSource(microphone, cameras(urls, clock), clock, seconds=seconds)
    tape = Tape(session, lambda folder: open_recorder(folder, source))
    summary = drive(
        Drive(
            source=source,
            driver=driver,
            clock=clock,
            sinks=[stats, probe],
            record=tape.append,
            realtime=True,
        )
    )
    tape.close()
    told = stats.report()
    metrics: dict[str, Any] = {
        "frames": summary.frames,
        "missed_ticks_percent": 100 * summary.dropped / max(summary.frames, 1),
        "worst_late_ms": round(summary.late_ns / 1e6, 1),
        "frames_with_gap_after_warm_up": probe.gaps,
        "audio_drift_ms": round(probe.drift_ms, 3),
        "memory_growth_mb": round(probe.growth_mb, 2),
        "eyes_valid_share": min(told["eye_left_valid"], told["eye_right_valid"]),
    }
    for stream in ("sound", "eye_left", "eye_right"):
        for name, value in told[f"{stream}_to_code"].items():
            metrics[f"{stream}_to_code_{name}"] = value
    return metrics, probe


def _replay(driver: Any, session: Path, seconds: float) -> SoakProbe:
    from app.drive.loop import Drive, drive
    from sensors.clock import MonotonicClock
    from sensors.session.recording import Recording
    from sensors.session.replay import ReplaySource

    clock, probe = MonotonicClock(), SoakProbe(seconds)
    source = ReplaySource(Recording(session), clock, eyes=driver.config.condition == "eyes")
    drive(Drive(source=source, driver=driver, clock=clock, sinks=[probe]))
    return probe
