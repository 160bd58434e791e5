"""`livedrive bench sensors`: the delay of each sensor, and what recording costs.

PulseAudio and two MJPEG servers with jitter -> sensors -> codes; nothing is drawn.
"""

import os
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from app.sinks.live_stats import LiveStats
from app.terminal.thresholds import at_least, at_most
from sensors.types import NS

RECORD_S = 20.0


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

    driver = load_driver(device="cpu")
    process, clock = psutil.Process(os.getpid()), MonotonicClock()
    with bench_world.microphone() as mic, bench_world.cameras(2) as urls:
        metrics = _drive_live(driver, mic, urls, RECORD_S)
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
        at_least("eyes_valid_share", metrics["eyes_valid_share"], 0.9),
    ]
    return {"metrics": metrics, "bars": thresholds}


def _drive_live(driver: Any, mic: str, urls: list[str], seconds: float) -> dict[str, Any]:
    """From sensors to codes, and nothing else."""
    from app.drive.loop import Drive, drive
    from sensors.audio.microphone import Microphone
    from sensors.cameras.spec import cameras
    from sensors.clock import MonotonicClock
    from sensors.live.source import LiveSource

    clock, stats = MonotonicClock(), LiveStats()
    source = LiveSource(Microphone(mic, clock), cameras(urls, clock), clock, seconds=seconds)
    parts = Drive(source=source, driver=driver, clock=clock, sinks=[stats], realtime=True)
    summary, told = drive(parts), stats.report()
    metrics: dict[str, Any] = {
        "frames": summary.frames,
        "missed_ticks_percent": 100 * summary.dropped / max(summary.frames, 1),
        "worst_late_ms": round(summary.late_ns / 1e6, 1),
        "eyes_valid_share": min(told["eye_left_valid"], told["eye_right_valid"]),
    }
    for stream in ("sound", "eye_left", "eye_right"):
        for name, value in told[f"{stream}_to_code"].items():
            metrics[f"{stream}_to_code_{name}"] = value
    return metrics
