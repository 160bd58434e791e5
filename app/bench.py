"""`livedrive bench`: what a tick costs, stage by stage, and what its heaviest stage costs alone."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from tyro.conf import Positional

What = Literal["tick", "render", "pictures", "sensors", "soak", "faults", "fuzz", "web"]


@dataclass(kw_only=True)
class Bench:
    """Measure latency, CPU time and memory against the bars of this project."""

    what: Positional[What] = "tick"
    """tick: every stage, at the pace of a live run. render: the splat renderer and its rivals.
    pictures: thousands of them, to see that nothing leaks. sensors: delays and recording, with
    stand-ins for microphone and cameras. soak: the same for --minutes, and its replay.
    faults: every way in which a sensor fails, --times each. fuzz: --num damaged inputs
    at every border. web: --minutes of sending by every protocol, a page, a hostile crowd."""
    session: Path = Path("recordings/demo")
    """Session to replay in real time (tick)."""
    avatar: str = "ben"
    size: int = 512
    """Width and height of the picture in pixels (tick)."""
    device: Literal["auto", "cpu", "cuda"] = "auto"
    minutes: float = 20.0
    """How long the sensors run (soak), or ticks are sent (web)."""
    times: int = 20
    """How often each fault happens (faults)."""
    num: int = 100_000
    """How many damaged inputs (fuzz)."""
    seed: int = 0
    """Of the damage (fuzz)."""
    report: Path | None = None
    """Write the figures as JSON."""

    def run(self) -> None:
        from app.bars import finish

        report = self.measure()
        if self.report:
            self.report.write_text(json.dumps(report, indent=2) + "\n")
        finish(report["bars"])

    def measure(self) -> dict[str, Any]:
        if self.what == "tick":
            from app.bench_tick import measure_tick

            return measure_tick(self.session, self.avatar, self.size, self.device)
        if self.what == "render":
            from app.bench_render import measure_render

            return measure_render(self.avatar)
        if self.what == "pictures":
            from app.bench_pictures import measure_pictures

            return measure_pictures()
        if self.what == "sensors":
            from app.bench_live import measure_sensors

            return measure_sensors()
        if self.what == "faults":
            from app.bench_faults import measure_faults

            return measure_faults(self.times)
        if self.what == "fuzz":
            from app.bench_fuzz import measure_fuzz

            return measure_fuzz(self.num, self.seed)
        if self.what == "web":
            from app.bench_web import measure_web

            return measure_web(self.session, self.avatar, self.minutes)
        from app.bench_live import measure_live_soak

        return measure_live_soak(self.minutes)
