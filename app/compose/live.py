"""The sensors of a live run, built from settings: microphone, eye cameras, and their recorder."""

from collections.abc import Generator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.compose.settings import HEAD_MODES, DriveSettings, LiveSettings
from sensors.types import SAMPLE_RATE, Clock, InputError

SOUND_BYTES_S, EYE_BYTES_S = 4 * SAMPLE_RATE, 1.8e6  # an eye: FFV1 at 30 Hz, measured

if TYPE_CHECKING:
    from app.web.sink import WebSink
    from app.xr.sink import XrSink
    from sensors.head.source import HeadSource
    from sensors.live.recorder import LiveRecorder
    from sensors.live.source import LiveMicrophone, LiveSource


def live_source(
    settings: LiveSettings,
    clock: Clock,
    page: "WebSink | None" = None,  # whose microphone "web" means
    xr: "XrSink | None" = None,  # whose headset "xr" means
) -> "LiveSource":
    """Check the settings and build the sensors; they are not opened yet."""
    from sensors.cameras.spec import cameras
    from sensors.live.source import LiveSource

    eyes, head = cameras(settings.eyes, clock), _head(settings.head, clock, page, xr)
    microphone = _microphone(settings.mic, clock, page)
    return LiveSource(microphone, eyes, clock, head=head, seconds=settings.seconds)


def _head(
    spec: str, clock: Clock, page: "WebSink | None", xr: "XrSink | None"
) -> "HeadSource | None":
    """The tracker of `--head`; auto: the headset of `--xr`, else that of the page."""
    if spec == "xr" or (spec == "auto" and xr is not None):
        from app.xr.headset import xr_head

        if xr is None:
            raise InputError(
                "--head xr: expected --xr, got none; try run --xr headless, or record --xr"
            )
        return xr_head(xr.memory, clock, tell, expected=spec == "xr")
    if spec == "web" or (spec == "auto" and page is not None):
        from app.web.headset_source import web_head

        if page is None:
            raise InputError(
                "--head web: expected the page of --web, got none; try run --web 8443 --head web"
            )
        return web_head(page.link, clock, tell, expected=spec == "web")
    if spec in HEAD_MODES:
        return None
    from sensors.head.spec import head_source

    return head_source(spec, clock, tell)


def _microphone(name: str | None, clock: Clock, page: "WebSink | None") -> "LiveMicrophone | None":
    if name == "none":
        return None
    if name == "web":
        from app.web.microphone import WebMicrophone

        if page is None:
            raise InputError("--mic web: expected the page of --web, got none; add --web 8443")
        return WebMicrophone(page.link, clock)
    from sensors.audio import portaudio
    from sensors.audio.microphone import Microphone

    if name is not None:
        name = portaudio.find_name(name)
    return Microphone(name, clock)


def open_page(settings: DriveSettings, clock: Clock, seats: str | None = None) -> "WebSink | None":
    """Start the page's server where `--web` is given; `seats`: the handle of a call's seats."""
    network = settings.network
    if network.web is None:
        return None
    from app.web.info import ServerInfo
    from app.web.sink import WebSink

    info = ServerInfo(
        network.host,
        network.web,
        settings.avatar,
        gaussians=settings.gaussians,
        microphone=network.microphone,
        head=network.head,
        sound=network.sound,
        gains=str(network.gains.resolve()) if network.gains else None,
        seats=seats,
    )
    return WebSink(info, clock)


def open_xr(settings: DriveSettings, clock: Clock, seats: str | None = None) -> "XrSink | None":
    """Start the headset's process where `--xr` is given; `seats`: the handle of a call's seats."""
    if settings.xr is None:
        return None
    from app.xr.link import XrInfo
    from app.xr.sink import XrSink

    info = XrInfo(
        settings.xr,
        settings.avatar,
        gaussians=settings.gaussians,
        background=settings.background,
        seats=seats,
    )
    return XrSink(info, clock, tell)


@contextmanager
def open_poses(clock: Clock) -> "Generator[XrSink]":
    """A headset used for its poses only; closed at the end."""
    from app.drive.sink import RunInfo
    from app.xr.link import XrInfo
    from app.xr.sink import XrSink

    sink = XrSink(XrInfo("headless", avatar=""), clock, tell)
    try:
        sink.on_start(RunInfo(0, 0, None))
        yield sink
    finally:
        sink.close()


def open_recorder(
    folder: Path,
    source: "LiveSource",
    calibration: Mapping[str, Any] | None = None,
    *,
    alone: bool = False,  # nothing is driven beside it
) -> "LiveRecorder":
    """Record into a new session. Raises InputError where the folder holds something already."""
    from datetime import UTC, datetime

    from sensors.live.recorder import LiveRecorder

    created = datetime.now(UTC).isoformat(timespec="seconds")
    info = source.info
    recorder = LiveRecorder(
        folder,
        created=created,
        devices=info.devices,
        tell=tell,
        calibration=calibration,
        alone=alone,
    )
    if not recorder.problem:
        tell(f"recording into {folder}: {_size(folder, len(info.eyes))}")
    return recorder


def _size(folder: Path, eyes: int) -> str:
    """Disk space of an hour, and the hours that fit."""
    import shutil

    an_hour = 3600 * (SOUND_BYTES_S + eyes * EYE_BYTES_S)
    hours = shutil.disk_usage(folder).free / an_hour
    return f"about {an_hour / 1e9:.1f} GB an hour, room for {hours:.0f} hours"


def tell(line: str) -> None:
    """Print one line to stderr."""
    import sys

    from app.terminal.console import one_line

    print(f"livedrive: {one_line(line)}", file=sys.stderr, flush=True)
