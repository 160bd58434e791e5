"""What is plugged in: cameras of the system, serial ports, USB devices, and why one cannot be used.

Flow: the operating system's lists -> FoundDevice -> `livedrive devices`, `livedrive doctor`.
Microphones are listed by sensors.audio.portaudio.
"""

# pyright: reportMissingTypeStubs=false
import errno
import os
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sensors.cameras.usb.camera import FOREIGN, describe, devices
from sensors.cameras.usb.descriptors import DescriptorError
from sensors.cameras.usb.profiles import profile, udev_rule
from sensors.types import InputError

V4L2_FOLDER = Path("/sys/class/video4linux")
RULES_FILE = "/etc/udev/rules.d/60-livedrive.rules"


@dataclass(frozen=True)
class FoundDevice:
    """One line of `livedrive devices`."""

    kind: str  # camera, serial, usb
    spec: str  # what --eyes takes
    name: str
    detail: str  # sizes and rates, where they are known
    headset: str  # the likely headset, or nothing
    problem: str = ""  # why it cannot be used now, with the fix


def found_devices(usb_backend: Any = None) -> Iterator[FoundDevice]:
    """Everything that may be an eye camera."""
    yield from _video_devices(V4L2_FOLDER)
    yield from _serial_ports()
    yield from _usb_devices(usb_backend)


def _video_devices(folder: Path) -> Iterator[FoundDevice]:
    """V4L2 devices, as Linux lists them in /sys."""
    if not folder.is_dir():
        return
    for entry in sorted(folder.iterdir()):
        number = entry.name.removeprefix("video")
        if not number.isdigit() or _text(entry / "index") not in ("0", ""):
            continue  # a second index is the same camera's metadata
        device = f"/dev/{entry.name}"
        problem = "" if os.access(device, os.R_OK | os.W_OK) else _no_access(device, "video")
        known = profile(*_usb_ids(entry / "device" / "modalias"))
        name, headset = _text(entry / "name"), known.name if known else ""
        yield FoundDevice("camera", f"uvc:{number}", name, device, headset, problem)


def _serial_ports() -> Iterator[FoundDevice]:
    from serial.tools import list_ports

    for port in list_ports.comports():
        if port.vid is None or port.pid is None:
            continue  # a port on the board; eye cameras come over USB
        problem = ""
        if sys.platform != "win32" and not os.access(port.device, os.R_OK | os.W_OK):
            problem = _no_access(port.device, "dialout")
        known = profile(int(port.vid), int(port.pid))
        name, headset = port.description or port.name, known.name if known else ""
        yield FoundDevice("serial", f"serial:{port.device}", name, "3 Mbaud", headset, problem)


def _usb_devices(backend: Any) -> Iterator[FoundDevice]:
    """USB devices that are known or that stream video in a way that needs no driver."""
    from usb import core

    for vendor, product, device in devices(backend):
        known = profile(vendor, product)
        spec, problem, detail = f"usb:{vendor:04x}:{product:04x}", "", ""
        try:
            size = describe(device).best()
            rate = 10_000_000 // max(size.interval, 1)
            detail = f"{size.width} x {size.height} {size.kind}, {rate} Hz"
        except DescriptorError:
            if known is None:
                continue
            problem = "its video needs the system's driver; use its uvc: line"
        except NotImplementedError:
            if known is None:
                continue
            problem = FOREIGN
        except core.USBError as error:
            if known is None:
                continue
            fix = "plug it in again"
            if error.errno == errno.EACCES:
                fix = _rule_hint(vendor, product)
            problem = f"{error.strerror or error}; {fix}"
        name = known.name if known else "USB video"
        yield FoundDevice("usb", spec, name, detail, known.name if known else "", problem)


def check_usb_library() -> str:
    """The libusb backend's name. Raises InputError with the fix where there is none."""
    from usb.backend import libusb1

    backend: Any = libusb1  # pyusb has no types
    if backend.get_backend() is None:
        raise InputError("expected libusb, got none; run: sudo apt-get install libusb-1.0-0")
    return "libusb 1.0"


def _rule_hint(vendor: int, product: int) -> str:
    rule = udev_rule(vendor, product)
    return f"run: echo '{rule}' | sudo tee -a {RULES_FILE}; then plug it in again"


def _no_access(device: str, group: str) -> str:
    return f"no permission for {device}; run: sudo usermod -aG {group} $USER; then log in again"


def _usb_ids(modalias: Path) -> tuple[int, int]:
    """Vendor and product of e.g. usb:v35BDp0202d0100..., or zeros."""
    match = re.match(r"usb:v([0-9A-F]{4})p([0-9A-F]{4})", _text(modalias))
    return (int(match.group(1), 16), int(match.group(2), 16)) if match else (0, 0)


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return ""
