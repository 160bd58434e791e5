"""The one place where the parts of a run are put together: settings in, a Drive out.

Used by replay and run, and by whatever else drives a head. More of the parts go in here: another
source of frames, another view, another panel.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from app.compose.density import load_decoder
from app.compose.live import open_page, open_xr, tell
from app.compose.settings import DriveSettings, FileSettings, HeadMode
from app.drive import background
from app.drive.controls import ControlPlace, Controls, Panel
from app.drive.emotion import said_with
from app.drive.emotion_port import OscPort
from app.drive.loop import Drive
from app.drive.sink import Expendable, RunInfo, Sink
from app.drive.stages import Stages
from sensors.types import LOOPBACK, Clock, Source

if TYPE_CHECKING:
    from app.call.live.tape import CallTape
    from app.call.table.seats import Seats
    from app.drive.tape import Tape
    from app.drive.view import PortraitView
    from app.web.sink import WebSink
    from app.window.sink import WindowSink
    from app.xr.sink import XrSink
    from encoder.alive.alive import Alive
    from encoder.driver import Driver
    from encoder.eyes.calibration import EyeCalibration
    from render.decoder.decoder import Decoder
    from render.decoder.identity import Identity
    from render.types import Gaussians


def load_driver(
    settings: DriveSettings, has_eyes: bool, calibration: "EyeCalibration | None" = None
) -> "Driver":
    """Load the networks; `has_eyes`: the source shows eyes. Raises InputError where the emotion
    of the settings cannot be shown."""
    from encoder import inference

    weights = settings.weights or inference.WEIGHTS
    condition = inference.choose_condition(settings.condition, has_eyes, weights)
    if condition == "eyes" and not has_eyes:
        tell("the upper face follows eye cameras, and there are none: it moves as if unseen")
    driver = inference.load_driver(
        weights, device=settings.device, condition=condition, calibration=calibration
    )
    driver.check_emotion(_emotion(settings, driver) or "")
    return driver


def build(
    settings: DriveSettings,
    *,
    source: Source,
    driver: "Driver",
    clock: Clock,
    sinks: Sequence[Sink] = (),  # beside those of the settings
    tape: "Tape | CallTape | None" = None,  # what the window's button starts and stops
    page: "WebSink | None" = None,  # already open; else the settings open one
    xr: "XrSink | None" = None,  # the same
    seats: "Seats | None" = None,  # of a call: partners are drawn too
    places: Sequence[ControlPlace] = (),  # of controls, beside window, page and --listen
) -> Drive:
    """All parts of a run; sinks and source are opened by `drive`."""
    from app.sinks.table import Outlet, open_all
    from app.terminal import compiling
    from render.decoder import identity

    compiling.announce(tell)
    who = identity.load(settings.avatar)
    decoder = load_decoder(settings, who, clock)
    settings = replace(settings, gaussians=decoder.density)
    frames = source.info.num_frames
    stages, emotion = Stages(), _emotion(settings, driver)
    listen = settings.listen
    port = None if listen is None else OscPort(LOOPBACK, listen, driver.check_emotion)
    driver.alive = _alive(settings.head, decoder)
    page, xr = page or open_page(settings, clock), xr or open_xr(settings, clock)
    if page and driver.emotions:
        page.link.say(emotions=driver.emotions.labels, controls={"emotion": emotion})
    outlet = Outlet(decoder, settings.avatar, clock, settings.network.gains)
    network = [*open_all(settings.network.send, outlet), *([page] if page else [])]
    window = _window(settings, emotion, driver, clock, stages, tape, frames, seats)
    view = _view(settings, decoder, who, clock, seats) if settings.needs_picture else None
    files = _file_sinks(settings, decoder, who)
    return Drive(
        source=source,
        driver=driver,
        clock=clock,
        sinks=[
            *(sink if frames is not None else Expendable(sink, path) for sink, path in files),
            *sinks,
            *network,
            *([window] if window else []),
            *([xr] if xr else []),
        ],
        view=view,
        panel=Panel(
            Controls(avatar=who.name, emotion=emotion),
            [place for place in (window, page and page.link, xr, port, *places) if place],
        ),
        ports=[port] if port else [],
        record=tape.append if tape else None,
        stages=stages,
        info=RunInfo(width=settings.size, height=settings.size, frames=frames),
        seed=settings.seed or 0,
        emotion=emotion or "",
        gaussians=decoder.density,
        realtime=settings.realtime,
    )


def _alive(mode: HeadMode, decoder: "Decoder") -> "Alive | None":
    """What moves the head and the face beside speech and eyes."""
    from encoder.alive.alive import Alive
    from encoder.alive.face import Shapes

    if mode == "still":
        return None
    return Alive(Shapes.of(decoder.rig_names, decoder.to_code, decoder.to_rig), mode)


def _emotion(settings: DriveSettings, driver: "Driver") -> str | None:
    """The emotion in words that the driver knows."""
    if settings.emotion and driver.emotions:
        return said_with(driver.emotions.labels, settings.emotion, settings.clip)
    return settings.emotion


def _view(
    settings: DriveSettings,
    decoder: "Decoder",
    who: "Identity",
    clock: Clock,
    seats: "Seats | None",
) -> "PortraitView":
    from app.drive.view import PortraitView
    from render import cameras
    from render.splats.renderer import create_renderer

    behind = background.flat(settings.background)
    camera = cameras.portrait(settings.size, settings.size, background=behind)
    around = _company(decoder, clock, seats) if seats else None
    return PortraitView(decoder, who, create_renderer(), camera, around)


def _company(
    decoder: "Decoder", clock: Clock, seats: "Seats"
) -> "Callable[[Gaussians], Gaussians]":
    from app.call.table.company import Company

    company = Company(decoder, seats)
    return lambda own: company.around(own, clock.now_ns())


def _window(
    settings: DriveSettings,
    emotion: str | None,
    driver: "Driver",
    clock: Clock,
    stages: Stages,
    tape: "Tape | CallTape | None",
    frames: int | None,
    seats: "Seats | None",
) -> "WindowSink | None":
    if not settings.window:
        return None
    from app.window.sink import WindowSink
    from app.window.state.shared import WindowInfo
    from render.decoder.learned import avatar_files

    info = WindowInfo(
        title=settings.title,
        avatar=settings.avatar,
        avatars=tuple(dict.fromkeys([*avatar_files.names(), settings.avatar])),  # or a file
        emotions=driver.emotions.labels if driver.emotions else (),
        emotion=emotion or "",
        can_record=tape is not None,
        live=frames is None,
        frames=frames,
        size=settings.size,
        background=settings.background,
        gaussians=settings.gaussians,
        seats=seats.handle if seats else None,
    )
    return WindowSink(info, clock, stages.latest_ms, tape)


def _file_sinks(
    settings: DriveSettings, decoder: "Decoder", who: "Identity"
) -> list[tuple[Sink, Path | None]]:
    """Each with what it writes."""
    from app.sinks.arkit import ArkitSink
    from app.sinks.clouds import CloudSink
    from app.sinks.motion import MotionSink
    from app.sinks.pictures import PictureSink
    from app.sinks.video import VideoSink
    from app.sinks.virtual_camera import VirtualCameraSink
    from render.avatars import gltf, ply

    files: FileSettings = settings.files
    sinks: list[tuple[Sink, Path | None]] = []
    if files.video:
        sinks.append((VideoSink(files.video), files.video))
    if files.pictures:
        transparent = settings.background == "transparent"
        sinks.append((PictureSink(files.pictures, files.every, transparent), files.pictures))
    if settings.virtual_camera:
        device = None if settings.virtual_camera == "auto" else settings.virtual_camera
        sinks.append((VirtualCameraSink(device), None))
    if files.ply:
        made = CloudSink(files.ply, files.every, ".ply", ply.save, decoder, who)
        sinks.append((made, files.ply))
    if files.gltf:
        made = CloudSink(files.gltf, files.every, ".glb", gltf.save, decoder, who)
        sinks.append((made, files.gltf))
    if files.motion:
        sinks.append((MotionSink(files.motion, decoder, who), files.motion))
    if files.arkit:
        sinks.append((ArkitSink(files.arkit, decoder), files.arkit))
    return sinks
