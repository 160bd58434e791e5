"""The eye cameras that `--eyes` can name: one row a scheme.

To add a camera: a file with its Link (sensors/picture.py says what that is), and a row here.
"""

import re
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sensors.cameras.camera import Connect
from sensors.cameras.views import Views
from sensors.session.eye_video import SIDE_BY_SIDE, open_video
from sensors.session.recording import Recording
from sensors.types import FPS, Clock, InputError


@dataclass(frozen=True)
class CameraTarget:
    """What a SPEC says beside its scheme."""

    text: str  # after the colon, without options
    views: Views
    usb_backend: Any = None  # of pyusb; None: libusb


@dataclass(frozen=True)
class CameraScheme:
    """One scheme. `open` raises InputError at a target that cannot be used, and returns what
    connects to the camera; it does not connect yet."""

    open: Callable[[CameraTarget, Clock], Connect]
    example: str
    help: str


def _uvc(target: CameraTarget, clock: Clock) -> Connect:
    from sensors.cameras.video import DriverLink

    device, container_format, options = target.text, "v4l2", dict[str, str]()
    if sys.platform == "win32":  # DirectShow counts no cameras
        if device.isdigit():
            raise InputError(
                f"--eyes uvc:{device}: expected the camera's name on Windows, got a number; "
                "try --eyes 'uvc:USB Camera', as the Device Manager calls it"
            )
        device, container_format = f"video={device}", "dshow"
    elif sys.platform == "darwin":
        container_format = "avfoundation"  # by number or name
        options = {"framerate": str(FPS)}  # no camera there has FFmpeg's own, 29.97
    elif device.isdigit():
        device = f"/dev/video{device}"
    return lambda: DriverLink(device, container_format, clock, options)


def _http(target: CameraTarget, clock: Clock) -> Connect:
    from sensors.cameras.mjpeg import MjpegLink, check_url

    url = f"http:{target.text}"
    check_url(url)
    return lambda: MjpegLink(url, clock)


def _serial(target: CameraTarget, clock: Clock) -> Connect:
    from sensors.cameras.openiris import SerialLink

    return lambda: SerialLink(target.text, clock)


def _usb(target: CameraTarget, clock: Clock) -> Connect:
    from sensors.cameras.usb.camera import UsbLink

    if not re.fullmatch(r"[0-9a-fA-F]{4}:[0-9a-fA-F]{4}", target.text):
        raise InputError(
            f"--eyes: expected usb:VENDOR:PRODUCT in hexadecimal, got 'usb:{target.text}'; "
            "see: livedrive devices"
        )
    vendor, product = (int(part, 16) for part in target.text.split(":"))
    return lambda: UsbLink(vendor, product, clock, target.usb_backend)


def _file(target: CameraTarget, clock: Clock) -> Connect:
    from sensors.cameras.video import PlayedCameraLink, file_pictures

    path = Path(target.text).expanduser()
    with open_video(path) as container:
        picture = container.streams.video[0].codec_context
        width, height = picture.width, picture.height
    views = target.views
    if len(views.eyes) == 2 and not views.crop and width < SIDE_BY_SIDE * height:
        raise InputError(
            f"--eyes: expected both eyes side by side in {path}, got {width} x {height}; add "
            f"#eye=left or #eye=right, or give two"
        )
    return lambda: PlayedCameraLink(file_pictures(path), clock)


def _session(target: CameraTarget, clock: Clock) -> Connect:
    from sensors.cameras.video import PlayedCameraLink, session_pictures

    path = Path(target.text).expanduser()
    with Recording(path) as recording:
        if not recording.eyes:
            raise InputError(
                f"--eyes: expected pictures of eyes, got none in session:{path}; choose another"
            )
    return lambda: PlayedCameraLink(session_pictures(path), clock)


SCHEMES: dict[str, CameraScheme] = {
    "uvc": CameraScheme(_uvc, "uvc:0", "a camera of the operating system, by number or device"),
    "http": CameraScheme(
        _http, "http://host:81/", "MJPEG over the network, e.g. OpenIris or EyeTrackVR"
    ),
    "serial": CameraScheme(_serial, "serial:/dev/ttyACM0", "OpenIris over USB serial"),
    "usb": CameraScheme(
        _usb, "usb:35bd:0202", "a USB camera without a driver, by vendor and product"
    ),
    "file": CameraScheme(_file, "file:eye.mkv", "a video, played over and over"),
    "session": CameraScheme(
        _session, "session:DIR", "the eyes of a recorded session, over and over"
    ),
}
EXAMPLES = ", ".join(entry.example for entry in SCHEMES.values())
HELP = "; ".join(f"{entry.example} ({entry.help})" for entry in SCHEMES.values())
