"""The SPECs of `--eyes`: where the eyes come from, in one line each. sensors/cameras/table.py lists
the schemes.

One SPEC shows both eyes side by side, two are left and right. After a `#` may come, with commas
between: eye=left | eye=right, swap, mirror, turn=90 | 180 | 270, crop=X:Y:WIDTH:HEIGHT; or alone
profile=NAME | FILE.json, a device of sensors/cameras/geometry.py.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from sensors.cameras.camera import Connect, EyeCamera
from sensors.cameras.geometry import EyeGeometry, profile, views_of
from sensors.cameras.table import EXAMPLES, SCHEMES, CameraTarget
from sensors.cameras.views import Views
from sensors.types import EYE_NAMES, Clock, InputError


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
    if not colon or not target or scheme not in SCHEMES:
        raise InputError(
            f"--eyes: expected a camera like {EXAMPLES}, got {text!r}; see: livedrive devices"
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
        "; try #eye=left"
    )


def _connect(spec: CameraSpec, clock: Clock, usb_backend: Any) -> Connect:
    target = CameraTarget(spec.target, spec.views, usb_backend)
    return SCHEMES[spec.scheme].open(target, clock)
