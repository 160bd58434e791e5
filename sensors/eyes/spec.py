"""Where the eyes come from, in one line each: the SPECs of `--eyes`.

    uvc:0  uvc:/dev/video2          a camera of the operating system
    http://host:81/                 MJPEG, e.g. OpenIris over Wi-Fi
    serial:/dev/ttyACM0             OpenIris over USB serial
    usb:35bd:0202                   a USB camera without a driver, by vendor and product
    file:eye.mkv  session:DIR       recorded pictures, played over and over

One SPEC shows both eyes side by side, two are left and right. After a `#` may come, with commas
between: eye=left | eye=right, swap, mirror, turn=90 | 180 | 270, crop=X:Y:WIDTH:HEIGHT; or alone
profile=NAME | FILE.json, a device of sensors/eye_geometry.py.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from sensors.eye_geometry import EyeGeometry, profile, views_of
from sensors.eye_video import open_video
from sensors.eyes.camera import Connect, EyeCamera
from sensors.eyes.views import Views
from sensors.recording import Recording
from sensors.types import EYE_NAMES, Clock, InputError

EXAMPLES = "uvc:0, http://host:81/, serial:/dev/ttyACM0, usb:35bd:0202, file:eye.mkv, session:DIR"


@dataclass(frozen=True)
class CameraSpec:
    """One parsed SPEC."""

    scheme: str
    target: str
    views: Views


def cameras(specs: Sequence[str], clock: Clock, usb_backend: Any = None) -> list[EyeCamera]:
    """Build, and do not open, the cameras of `--eyes`. `usb_backend` None: libusb."""
    if len(specs) > 2:
        raise InputError(f"--eyes: expected one or two cameras, got {len(specs)}; left, then right")
    eyes = [(0,), (1,)] if len(specs) == 2 else [(0, 1)]
    parsed = [parse(text, default) for text, default in zip(specs, eyes, strict=False)]
    shown = [eye for spec in parsed for eye in spec.views.eyes]
    if len(set(shown)) < len(shown):
        raise InputError("--eyes: expected each eye once, got one twice; drop the #eye=")
    return [
        EyeCamera(text, _connect(spec, clock, usb_backend), spec.views, clock)
        for text, spec in zip(specs, parsed, strict=True)
    ]


def parse(text: str, eyes: tuple[int, ...] = (0, 1)) -> CameraSpec:
    """Read one SPEC; `eyes` are those it shows unless it says so itself."""
    source, _, options = text.partition("#")
    scheme, colon, target = source.partition(":")
    if not colon or not target or scheme not in ("uvc", "http", "serial", "usb", "file", "session"):
        raise InputError(f"--eyes: expected a camera like {EXAMPLES}; got {text!r}")
    if scheme == "http":
        target = source
    if scheme == "usb" and not re.fullmatch(r"[0-9a-fA-F]{4}:[0-9a-fA-F]{4}", target):
        raise InputError(
            f"--eyes: expected usb:VENDOR:PRODUCT in hexadecimal, got {text!r}; "
            "see: livedrive devices"
        )
    views = Views(eyes=eyes)
    if options.startswith("profile="):
        name = options.removeprefix("profile=")
        path = Path(name)
        known = EyeGeometry.load(path) if path.suffix == ".json" else profile(name)
        return CameraSpec(scheme, target, views_of(known, eyes))
    for option in filter(None, options.split(",")):
        views = _with_option(views, option)
    return CameraSpec(scheme, target, views)


def _with_option(views: Views, option: str) -> Views:
    name, _, value = option.partition("=")
    if option == "swap" and len(views.eyes) == 2:
        return replace(views, eyes=views.eyes[::-1])
    if option == "mirror":
        return replace(views, mirror=True)
    if name == "eye" and value in EYE_NAMES:
        return replace(views, eyes=(EYE_NAMES.index(value),))
    if name == "turn" and value in ("90", "180", "270"):
        return replace(views, turns=int(value) // 90)
    if name == "crop" and re.fullmatch(r"\d{1,4}(:\d{1,4}){3}", value):
        x, y, width, height = map(int, value.split(":"))
        if min(width, height) >= 32:
            return replace(views, crop=(x, y, width, height))
    raise InputError(
        f"--eyes: expected after the # eye=left, eye=right, swap (of one camera for both), mirror, "
        f"turn=90, crop=X:Y:WIDTH:HEIGHT (at least 32 x 32), or profile=NAME alone, got {option!r}"
    )


def _connect(spec: CameraSpec, clock: Clock, usb_backend: Any) -> Connect:
    """A function that opens the camera; files are checked now."""
    target = spec.target
    if spec.scheme == "http":
        from sensors.eyes.mjpeg import MjpegLink

        return lambda: MjpegLink(target, clock)
    if spec.scheme == "serial":
        from sensors.eyes.openiris import SerialLink

        return lambda: SerialLink(target, clock)
    if spec.scheme == "usb":
        from sensors.usb.camera import UsbLink

        vendor, product = (int(part, 16) for part in target.split(":"))
        return lambda: UsbLink(vendor, product, clock, usb_backend)
    from sensors.eyes.video import DriverLink, PlayedLink, file_pictures, session_pictures

    if spec.scheme == "uvc":
        device = f"/dev/video{target}" if target.isdigit() else target
        return lambda: DriverLink(device, "v4l2", clock)
    path = Path(target)
    if spec.scheme == "file":
        open_video(path).close()
        return lambda: PlayedLink(file_pictures(path), clock)
    Recording(path).close()
    return lambda: PlayedLink(session_pictures(path), clock)
