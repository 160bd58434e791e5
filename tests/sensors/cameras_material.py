"""Eye cameras that a test opens by their SPEC, and what they give."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Protocol

from waiting import wait_until

from sensors.cameras.camera import EyeCamera
from sensors.cameras.spec import cameras
from sensors.clock import MonotonicClock
from sensors.types import EyePacket


class Start(Protocol):
    """Opens the camera of a SPEC; `usb` is the backend of a stand-in."""

    def __call__(self, spec: str, usb: Any = None) -> EyeCamera: ...


@contextmanager
def opening() -> Iterator[Start]:
    """What it opens is closed at the end."""
    opened: list[EyeCamera] = []

    def start(spec: str, usb: Any = None) -> EyeCamera:
        (camera,) = cameras([spec], MonotonicClock(), usb)
        camera.open()
        opened.append(camera)
        return camera

    yield start
    for camera in opened:
        camera.close()


def collect(camera: EyeCamera, num: int) -> list[EyePacket]:
    packets: list[EyePacket] = []
    wait_until(
        lambda: bool(packets.extend(camera.poll()) or len(packets) >= num), f"{num} pictures"
    )
    return packets
