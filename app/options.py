"""What `replay` and `run` share: who is driven and how, what is drawn, what is written."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from app import background
from app.network import NetworkOptions, network_report
from render.types import Density
from sensors.types import FPS, Clock, InputError, Source

if TYPE_CHECKING:
    from app.emotion import EmotionControl
    from app.sinks.sink import Sink
    from app.stages import Stages
    from app.tape import Tape
    from app.web.sink import WebSink
    from app.window.sink import WindowSink
    from encoder.driver import Driver
    from render.decoder import Decoder
    from render.identity import Identity

MAX_SIZE = 4096


@dataclass(kw_only=True)
class DriveOptions(NetworkOptions):
    """Options of every command that drives the head."""

    video: Path | None = None
    """Write a video with sound, e.g. out.mp4."""
    pictures: Path | None = None
    """Write PNG pictures into this folder."""
    every: int = 30
    """Frames from one picture, PLY or glTF to the next."""
    motion: Path | None = None
    """Write codes, gaze, blendshapes and vertices, e.g. out.npz."""
    arkit: Path | None = None
    """Write a Live Link Face table, e.g. out.csv."""
    ply: Path | None = None
    """Write the Gaussians of every n-th frame into this folder, as PLY."""
    gltf: Path | None = None
    """Write the Gaussians of every n-th frame into this folder, as glTF."""
    report: Path | None = None
    """Write timings and settings, e.g. out.json."""
    window: bool = False
    """Show the head in a window; F1 there lists the keys."""
    virtual_camera: Annotated[str | None, tyro.conf.arg(metavar="DEVICE|auto")] = None
    """Be a webcam for video calls: a v4l2loopback device like /dev/video10, or auto."""
    background: str = "studio"
    """Behind the head: studio, grey, white, green, transparent or #rrggbb."""
    avatar: str = "ben"
    """Who is driven; see: livedrive avatar list."""
    gaussians: Density = "32k"
    """On the head, without its hair; fewer for a slower computer or a phone at --web."""
    emotion: Annotated[str | None, tyro.conf.arg(metavar="NAME[:INTENSITY]")] = None
    """What the face shows beside speech: happy, sad:0.7, happy:0.5+surprised:0.3, neutral.
    A replay shows what was recorded unless this is given."""
    clip: Path | None = None
    """Folder of a CLIP model, to understand other words for --emotion."""
    listen: Annotated[int | None, tyro.conf.arg(metavar="PORT")] = None
    """UDP port on this machine for OSC messages /livedrive/emotion happy:0.7."""
    condition: Literal["auto", "gaze", "eyes"] = "auto"
    """What drives the upper face: synthesised gaze, or the eye cameras; auto: whatever there is."""
    size: Annotated[int, tyro.conf.arg(metavar="PX")] = 512
    """Width and height of the picture, in pixels."""
    seed: int = 0
    """Seed of the diffusion noise and of the gaze."""
    device: Literal["auto", "cpu", "cuda"] = "auto"
    """Where the networks run; with cuda, the decoder too."""

    def load_driver(self, has_eyes: bool = False) -> "Driver":
        """Check the options and load the networks; `has_eyes`: the source shows eyes."""
        if not 64 <= self.size <= MAX_SIZE or self.size % 2:
            raise InputError(
                f"--size: expected an even number in 64..{MAX_SIZE}, got {self.size}; "
                "try --size 512"
            )
        transparent = background.fill(self.background) == background.FILLS["transparent"]
        if transparent and (self.video or self.virtual_camera):
            raise InputError(
                "--background: expected a colour, as videos and cameras have no alpha, "
                "got 'transparent'; try --background green"
            )
        from encoder.inference import choose_condition, load_driver

        condition = choose_condition(self.condition, has_eyes)
        driver = load_driver(device=self.device, condition=condition)
        if self.emotion and driver.emotions:
            from app.emotion import said_with

            self.emotion = said_with(driver.emotions.labels, self.emotion, self.clip)
        driver.check_emotion(self.emotion or "")
        return driver

    def _emotion_control(self, driver: "Driver") -> "EmotionControl":
        from app.emotion import EmotionControl, OscPort

        port = None
        if self.listen is not None:
            port = OscPort("127.0.0.1", self.listen, driver.check_emotion)
        return EmotionControl(self.emotion, port)

    def drive(
        self,
        source: Source,
        driver: "Driver",
        clock: Clock,
        *,
        realtime: bool,
        draw: bool,
        title: str = "live",  # of the window
        live: bool = False,  # a microphone can be muted
        frames: int | None = None,  # how many will come, where that is known
        more_sinks: Sequence["Sink"] = (),
        tape: "Tape | None" = None,
        page: "WebSink | None" = None,  # of a run that listens to it; else --web opens one
    ) -> dict[str, Any]:
        """Drive the head from `source` until it ends or Ctrl-C; return the report (DESIGN 4)."""
        from app.loop import Head, drive
        from app.sinks.sink import RunInfo
        from app.stages import Stages
        from encoder.inference import STUDENTS
        from render import cameras, identity
        from render.decoder import Decoder
        from render.renderer import create_renderer
        from render.torch_decoder import on_device

        who, decoder = identity.load(self.avatar), Decoder.load(gaussians=self.gaussians)
        stages, emotions = Stages(), self._emotion_control(driver)
        page = page or self.open_web(clock, self.avatar, self.gaussians)
        network = self.network_sinks(clock, decoder, self.avatar, page)
        sinks = [*self._sinks(decoder, who), *more_sinks, *network]
        window = None
        if self.window:
            labels = driver.emotions.labels if driver.emotions else ()
            window = self._open_window(clock, stages, title, live, frames, tape, labels)
            sinks.append(window)
        draw = draw or bool(self.video or self.pictures or self.virtual_camera)
        renderer = create_renderer() if draw else None
        behind = background.flat(self.background)
        camera = cameras.portrait(self.size, self.size, background=behind)
        head = Head(on_device(decoder, self.device), who, renderer, camera) if renderer else None
        info = RunInfo(width=self.size, height=self.size, frames=frames)
        try:
            summary = drive(
                *(source, driver, head, sinks, clock, stages, info, self.seed, realtime),
                panel=window,
                emotions=emotions,
                record=tape.append if tape else None,
            )
        finally:
            emotions.close()
            if renderer:
                renderer.close()
        return {
            "frames": summary.frames,
            "dropped": summary.dropped,
            "seconds": summary.frames / FPS,
            "late_ms": round(summary.late_ns / 1e6, 3),
            "renderer": renderer.name if renderer else "none",
            "device": self.device,
            "backend": driver.backend.name,
            "seed": self.seed,
            "condition": driver.config.condition,
            "checkpoint": STUDENTS[driver.config.condition],
            "avatar": self.avatar,
            "gaussians": self.gaussians,
            "emotion": self.emotion or "",
            "stages": stages.summary(),
            **network_report(network),
        }

    def finish(self, report: dict[str, Any]) -> None:
        """Write the report where it was asked for, and say what was done."""
        if self.report:
            self.report.write_text(json.dumps(report, indent=2) + "\n")
        tick = report["stages"]["tick"]
        print(
            f"{report['frames']} frames ({report['seconds']:.1f} s), {report['dropped']} dropped, "
            f"tick p50 {tick['p50_ms']:.1f} ms, p99 {tick['p99_ms']:.1f} ms, "
            f"{report['renderer']}, {report['backend']}"
        )
        files = (self.video, self.pictures, self.motion, self.arkit, self.ply, self.gltf)
        for path in (*files, self.report):
            if path:
                print(f"wrote {path.resolve()}")

    def _open_window(
        self,
        clock: Clock,
        stages: "Stages",
        title: str,
        live: bool,
        frames: int | None,
        tape: "Tape | None",
        emotions: tuple[str, ...],
    ) -> "WindowSink":
        from app.window.shared import WindowInfo
        from app.window.sink import WindowSink
        from render import identity

        info = WindowInfo(
            title=title,
            avatar=self.avatar,
            avatars=tuple(identity.names()),
            emotions=emotions,
            emotion=self.emotion or "",
            can_record=tape is not None,
            live=live,
            frames=frames,
            size=self.size,
            background=self.background,
            gaussians=self.gaussians,
        )
        return WindowSink(info, clock, stages.latest_ms, tape)

    def _sinks(self, decoder: "Decoder", who: "Identity") -> list["Sink"]:
        from app.sinks.arkit import ArkitSink
        from app.sinks.clouds import CloudSink
        from app.sinks.motion import MotionSink
        from app.sinks.pictures import PictureSink
        from app.sinks.video import VideoSink
        from app.sinks.virtual_camera import VirtualCameraSink
        from render import gltf, ply

        sinks: list[Sink] = []
        if self.video:
            sinks.append(VideoSink(self.video))
        if self.pictures:
            transparent = self.background == "transparent"
            sinks.append(PictureSink(self.pictures, self.every, transparent))
        if self.virtual_camera:
            device = None if self.virtual_camera == "auto" else self.virtual_camera
            sinks.append(VirtualCameraSink(device))
        if self.ply:
            sinks.append(CloudSink(self.ply, self.every, ".ply", ply.save, decoder, who))
        if self.gltf:
            sinks.append(CloudSink(self.gltf, self.every, ".glb", gltf.save, decoder, who))
        if self.motion:
            sinks.append(MotionSink(self.motion, decoder, who))
        if self.arkit:
            sinks.append(ArkitSink(self.arkit, decoder))
        return sinks
