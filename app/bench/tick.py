"""The whole tick, paced by the clock and not in a hot loop.

At 30 Hz the weights leave the caches between two ticks: a hot loop flatters by 1.5 to 3 times.
"""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.terminal.thresholds import at_most

if TYPE_CHECKING:
    from app.compose.settings import DriveSettings


def measure_tick(session: Path, settings: "DriveSettings") -> dict[str, Any]:
    """Replay a session in real time; the report holds metrics and thresholds."""
    import psutil

    from app.compose.replay import replay
    from app.sinks.progress import ProgressSink

    measured = replay(session, settings, [ProgressSink()])
    stages = measured["stages"]
    metrics = {f"{s}_{k}": v for s, values in stages.items() for k, v in values.items()}
    metrics["dropped_ticks"] = measured["dropped"]
    metrics["memory_mb"] = round(psutil.Process(os.getpid()).memory_info().rss / 2**20, 1)
    encoder = metrics["audio_own_ms"] + metrics["denoise_own_ms"]  # one thread each
    thresholds = [
        at_most("tick_p50_ms", metrics["tick_p50_ms"], 22.0),
        at_most("tick_p99_ms", metrics["tick_p99_ms"], 33.0),
        at_most("encoder_cpu_ms", encoder, 4.0),
        at_most("dropped_ticks", metrics["dropped_ticks"], 0),
    ]
    show(stages)
    report = {k: measured[k] for k in ("renderer", "device", "backend", "frames")}
    return report | {"metrics": metrics, "bars": thresholds}


def show(stages: dict[str, dict[str, float]]) -> None:
    from app.terminal.console import console, numbers

    table = numbers("stage", "p50 ms", "p95 ms", "p99 ms", "CPU ms", "own thread")
    parts = ("p50_ms", "p95_ms", "p99_ms", "cpu_ms", "own_ms")
    for name, v in stages.items():
        table.add_row(name, *(f"{v[k]:.2f}" for k in parts))
    console().print(table)
