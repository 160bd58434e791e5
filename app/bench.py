"""`livedrive bench`: what a tick costs, stage by stage, at the pace of a live run.

Paced by the clock and not in a hot loop, because at 30 Hz the weights leave the caches between two
ticks (a hot loop flatters by 1.5 to 3 times).
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Literal


@dataclass(kw_only=True)
class Bench:
    """Measure latency, CPU time and memory on a session."""

    session: Path = Path("recordings/demo")
    """Session to replay in real time."""
    avatar: str = "ben"
    size: int = 512
    device: Literal["auto", "cpu", "cuda"] = "auto"
    report: Path | None = None
    """Write the figures as JSON."""

    def run(self) -> None:
        import os
        from tempfile import TemporaryDirectory

        import psutil

        from app.bars import at_most, finish
        from app.replay import Replay

        with TemporaryDirectory() as folder:
            path = Path(folder) / "report.json"
            replay = Replay(
                session=self.session,
                realtime=True,
                avatar=self.avatar,
                size=self.size,
                device=self.device,
                report=path,
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
        report = {k: measured[k] for k in ("renderer", "device", "backend", "frames")}
        report |= {"metrics": metrics, "bars": bars}
        if self.report:
            self.report.write_text(json.dumps(report, indent=2) + "\n")
        show(stages)
        finish(bars)


def show(stages: dict[str, dict[str, float]]) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table("stage", "p50 ms", "p95 ms", "p99 ms", "CPU ms")
    for name, v in stages.items():
        table.add_row(name, *(f"{v[k]:.2f}" for k in ("p50_ms", "p95_ms", "p99_ms", "cpu_ms")))
    Console().print(table)
