"""The whole tick, paced by the clock and not in a hot loop.

At 30 Hz the weights leave the caches between two ticks: a hot loop flatters by 1.5 to 3 times.
"""

import json
import os
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

from app.bars import at_most


def measure_tick(
    session: Path, avatar: str, size: int, device: Literal["auto", "cpu", "cuda"]
) -> dict[str, Any]:
    """Replay a session in real time; the report holds metrics and bars (DESIGN 4)."""
    import psutil

    from app.replay import Replay

    with TemporaryDirectory() as folder:
        path = Path(folder) / "report.json"
        replay = Replay(
            session=session, realtime=True, avatar=avatar, size=size, device=device, report=path
        )
        replay.run()
        measured = json.loads(path.read_text())
    stages = measured["stages"]
    metrics = {f"{s}_{k}": v for s, values in stages.items() for k, v in values.items()}
    metrics["dropped_ticks"] = measured["dropped"]
    metrics["memory_mb"] = round(psutil.Process(os.getpid()).memory_info().rss / 2**20, 1)
    bars = [
        at_most("tick_p50_ms", metrics["tick_p50_ms"], 22.0),
        at_most("tick_p99_ms", metrics["tick_p99_ms"], 33.0),
        at_most("encoder_cpu_ms", metrics["audio_cpu_ms"] + metrics["denoise_cpu_ms"], 4.0),
        at_most("dropped_ticks", metrics["dropped_ticks"], 0),
    ]
    show(stages)
    report = {k: measured[k] for k in ("renderer", "device", "backend", "frames")}
    return report | {"metrics": metrics, "bars": bars}


def show(stages: dict[str, dict[str, float]]) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table("stage", "p50 ms", "p95 ms", "p99 ms", "CPU ms")
    for name, v in stages.items():
        table.add_row(name, *(f"{v[k]:.2f}" for k in ("p50_ms", "p95_ms", "p99_ms", "cpu_ms")))
    Console().print(table)
