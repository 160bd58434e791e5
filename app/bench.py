"""`livedrive bench`: what a tick costs, stage by stage, at the pace of a live run.

Paced by the clock and not in a hot loop, because at 30 Hz the weights leave the caches between two
ticks (a hot loop flatters by 1.5 to 3 times).
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal



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
            bar("tick_p50_ms", metrics["tick_p50_ms"], 22.0),
            bar("tick_p99_ms", metrics["tick_p99_ms"], 33.0),
            bar("encoder_cpu_ms", metrics["audio_cpu_ms"] + metrics["denoise_cpu_ms"], 4.0),
            bar("dropped_ticks", metrics["dropped_ticks"], 0),
        ]
        report = {k: measured[k] for k in ("renderer", "device", "backend", "frames")}
        report |= {"metrics": metrics, "bars": bars}
        if self.report:
            self.report.write_text(json.dumps(report, indent=2) + "\n")
        show(stages, bars)
        if not all(b["ok"] for b in bars):
            raise SystemExit(1)


def bar(name: str, value: float, limit: float) -> dict[str, Any]:
    """One figure that must not exceed its limit."""
    return {"name": name, "value": round(value, 3), "bar": limit, "ok": value <= limit}


def show(stages: dict[str, dict[str, float]], bars: list[dict[str, Any]]) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table("stage", "p50 ms", "p95 ms", "p99 ms", "CPU ms")
    for name, v in stages.items():
        table.add_row(name, *(f"{v[k]:.2f}" for k in ("p50_ms", "p95_ms", "p99_ms", "cpu_ms")))
    limits = Table("figure", "value", "bar", "")
    for b in bars:
        limits.add_row(b["name"], f"{b['value']:.2f}", f"<= {b['bar']}", "ok" if b["ok"] else "FAILED")
    console = Console()
    console.print(table)
    console.print(limits)
