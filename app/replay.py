"""`livedrive replay SESSION`: a recorded session becomes a talking head."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from sensors.types import InputError

MAX_SIZE = 4096


@dataclass(kw_only=True)
class Replay:
    """Drive the head from a recorded session."""

    session: tyro.conf.Positional[Path]
    """Folder of the session, e.g. recordings/demo."""
    fast: bool = False
    """As fast as the machine can (the default)."""
    realtime: bool = False
    """At the pace of the recording; late pictures are dropped, steps never."""
    video: Path | None = None
    """Write a video with sound, e.g. out.mp4."""
    pictures: Path | None = None
    """Write PNG pictures into this folder."""
    every: int = 30
    """Frames from one picture to the next."""
    motion: Path | None = None
    """Write codes, gaze, blendshapes and vertices, e.g. out.npz."""
    arkit: Path | None = None
    """Write a Live Link Face table, e.g. out.csv."""
    report: Path | None = None
    """Write timings and settings, e.g. out.json."""
    avatar: str = "ben"
    """Who is driven; see: livedrive avatar list."""
    condition: Literal["auto", "gaze"] = "auto"
    """What drives the upper face: synthesised gaze."""
    size: Annotated[int, tyro.conf.arg(metavar="PX")] = 512
    """Width and height of the picture, in pixels."""
    seed: int = 0
    """Seed of the diffusion noise and of the gaze."""
    device: Literal["auto", "cpu", "cuda"] = "auto"
    """Where the networks run."""

    def run(self) -> None:
        if self.fast and self.realtime:
            raise InputError("pace: expected --fast or --realtime, got both; give one")
        if not 64 <= self.size <= MAX_SIZE or self.size % 2:
            raise InputError(
                f"--size: expected an even number in 64..{MAX_SIZE}, got {self.size}; "
                "try --size 512"
            )
        from app.loop import Head, drive
        from app.sinks.sink import RunInfo
        from app.stages import Stages
        from encoder.inference import load_driver
        from render import cameras, identity
        from render.decoder import Decoder
        from render.renderer import create_renderer
        from sensors.clock import MonotonicClock
        from sensors.recording import Recording
        from sensors.replay import ReplaySource

        recording = Recording(self.session)
        who, decoder = identity.load(self.avatar), Decoder.load()
        driver = load_driver(device=self.device)
        sinks = self._sinks(decoder, who)
        stages, clock = Stages(), MonotonicClock()
        renderer = create_renderer() if self._draws() else None
        camera = cameras.portrait(self.size, self.size)
        head = Head(decoder, who, renderer, camera) if renderer else None
        frames = recording.duration_ns * 30 // 1_000_000_000
        source = ReplaySource(
            recording, clock, self.realtime, eyes=driver.config.condition == "eyes"
        )
        info = RunInfo(width=self.size, height=self.size, frames=frames)
        try:
            summary = drive(
                source, driver, head, sinks, clock, stages, info, self.seed, self.realtime
            )
        finally:
            if renderer:
                renderer.close()
        report = {
            "frames": summary.frames,
            "dropped": summary.dropped,
            "seconds": summary.frames / 30,
            "late_ms": round(summary.late_ns / 1e6, 3),
            "renderer": renderer.name if renderer else "none",
            "device": self.device,
            "backend": driver.backend.name,
            "seed": self.seed,
            "condition": driver.config.condition,
            "checkpoint": "student",
            "avatar": self.avatar,
            "stages": stages.summary(),
        }
        if self.report:
            self.report.write_text(json.dumps(report, indent=2) + "\n")
        self._tell(report)

    def _draws(self) -> bool:
        """Codes alone need no picture; --realtime always draws, as a live run does."""
        return bool(self.video or self.pictures or self.realtime or self.report)

    def _sinks(self, decoder, who) -> list:  # type: ignore[no-untyped-def]
        from app.sinks.arkit import ArkitSink
        from app.sinks.motion import MotionSink
        from app.sinks.pictures import PictureSink
        from app.sinks.progress import ProgressSink
        from app.sinks.video import VideoSink

        sinks = []
        if self.video:
            sinks.append(VideoSink(self.video))
        if self.pictures:
            sinks.append(PictureSink(self.pictures, self.every))
        if self.motion:
            sinks.append(MotionSink(self.motion, decoder, who))
        if self.arkit:
            sinks.append(ArkitSink(self.arkit, decoder))
        return [*sinks, ProgressSink()]

    def _tell(self, report: dict) -> None:
        tick = report["stages"]["tick"]
        print(
            f"{report['frames']} frames ({report['seconds']:.1f} s), {report['dropped']} dropped, "
            f"tick p50 {tick['p50_ms']:.1f} ms, p99 {tick['p99_ms']:.1f} ms, "
            f"{report['renderer']}, {report['backend']}"
        )
        for path in (self.video, self.pictures, self.motion, self.arkit, self.report):
            if path:
                print(f"wrote {path.resolve()}")
