"""`livedrive bench`: what a tick costs, stage by stage, and what its heaviest stage costs alone."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from tyro.conf import Positional

from app.terminal import confirm, outputs
from app.terminal.arguments import Count, File, Seed, check_taken
from render.types import DENSITY, Density
from sensors.types import InputError

MAX_MINUTES = 60 * 24 * 7
TAKEN_BY = {
    "session": ("tick", "web", "xr"),
    "avatar": ("tick", "render", "web", "xr"),
    **dict.fromkeys(("size", "gaussians", "device"), ("tick",)),
    "minutes": ("soak", "web"),
    "times": ("faults",),
    **dict.fromkeys(("num", "processes", "keep"), ("fuzz",)),
    "seed": ("fuzz", "peers"),
}

What = Literal[
    "tick", "render", "pictures", "sensors", "soak", "faults", "fuzz", "web", "peers", "xr"
]


@dataclass(kw_only=True)
class Bench:
    """Measure latency, CPU time and memory against this project's thresholds."""

    what: Positional[What] = "tick"
    """tick: all stages at the pace of a live run. render: the splat renderer against two others.
    pictures: memory over thousands of pictures. sensors: delays and recording with stand-ins for
    microphone and cameras. soak: everything at once for --minutes (voice, eyes, head, window,
    page, sending, recording), then the replay. faults: every failure of a sensor, --times each.
    fuzz: --num damaged inputs to every reader. web: --minutes of sending by every protocol, with
    a page and hostile clients. peers: networks with the shapes of other papers against ours, time
    to the first frame of new sound. xr: stereo frames for a headset with a stand-in for its
    runtime, and the tick beside it."""
    session: Path = Path("recordings/demo")
    """Session to replay in real time (tick, web, xr)."""
    avatar: str = "ben"
    """Avatar to drive (tick, render, web, xr)."""
    size: int = 512
    """Width and height of the picture in pixels (tick)."""
    gaussians: Density = DENSITY
    """Gaussians of the head without hair (tick)."""
    device: Literal["auto", "cpu", "cuda"] = "auto"
    """Where the networks run (tick)."""
    minutes: float = 20.0
    """Length of the run (soak, web)."""
    times: Count = 20
    """How often to cause each fault (faults)."""
    num: Count = 100_000
    """Number of damaged inputs (fuzz)."""
    processes: Count = 1
    """Processes that share the work (fuzz)."""
    keep: File = None
    """Folder for progress and findings; the same command continues from there (fuzz)."""
    seed: Seed = 0
    """Seed of the damage (fuzz) or of the untrained weights (peers)."""
    report: File = None
    """Write the metrics as JSON."""

    def run(self) -> None:
        from app.terminal.thresholds import finish

        check_taken(self, TAKEN_BY, self.what, "benches")
        outputs.check("--report", self.report, outputs.REPORTS)
        confirm.overwriting([self.report])
        if not 0 < self.minutes <= MAX_MINUTES:
            raise InputError(
                f"--minutes: expected more than 0, at most {MAX_MINUTES}, got {self.minutes:g}; "
                "try --minutes 20"
            )

        measures: dict[What, Callable[[], dict[str, Any]]] = {
            "tick": self._tick,
            "render": self._render,
            "pictures": self._pictures,
            "sensors": self._sensors,
            "soak": self._soak,
            "faults": self._faults,
            "fuzz": self._fuzz,
            "web": self._web,
            "peers": self._peers,
            "xr": self._xr,
        }
        finish(measures[self.what](), self.report)

    def _tick(self) -> dict[str, Any]:
        from app.bench.tick import measure_tick
        from app.compose.settings import DriveSettings

        settings = DriveSettings(
            avatar=self.avatar,
            size=self.size,
            gaussians=self.gaussians,
            device=self.device,
            realtime=True,
            draw=True,
        )
        return measure_tick(self.session, settings)

    def _render(self) -> dict[str, Any]:
        from app.bench.render import measure_render

        return measure_render(self.avatar)

    def _pictures(self) -> dict[str, Any]:
        from app.bench.pictures import measure_pictures

        return measure_pictures()

    def _sensors(self) -> dict[str, Any]:
        from app.bench.sensors.live import measure_sensors

        return measure_sensors()

    def _soak(self) -> dict[str, Any]:
        from app.bench.sensors.soak import measure_soak

        return measure_soak(self.minutes)

    def _faults(self) -> dict[str, Any]:
        from app.bench.sensors.faults import measure_faults

        return measure_faults(self.times)

    def _fuzz(self) -> dict[str, Any]:
        from app.bench.fuzz.run import measure_fuzz

        return measure_fuzz(self.num, self.seed, self.processes, self.keep)

    def _peers(self) -> dict[str, Any]:
        from app.bench.peers.race import measure_peers

        return measure_peers(self.seed)

    def _web(self) -> dict[str, Any]:
        from app.bench.network.web import measure_web

        return measure_web(self.session, self.avatar, self.minutes)

    def _xr(self) -> dict[str, Any]:
        from app.bench.xr.frames import measure_frames
        from app.bench.xr.ticks import measure_ticks

        renderer, frames = measure_frames(self.avatar)
        ticks, thresholds = measure_ticks(self.session, self.avatar)
        return {"renderer": renderer, "metrics": frames | ticks, "bars": thresholds}
