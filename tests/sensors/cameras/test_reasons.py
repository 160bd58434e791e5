"""A camera that cannot be had is told in plain words, with the command that lists cameras."""

import errno
import socket
from collections.abc import Iterator

import pytest

from sensors.cameras import reasons
from sensors.cameras.spec import cameras
from sensors.cameras.video import DriverLink
from sensors.clock import MonotonicClock
from sensors.picture import CameraLostError


@pytest.mark.parametrize(
    ("spec", "told"),
    [
        ("uvc:97", "it is not there; see: livedrive devices"),
        ("serial:/dev/none", "it is not there; see: livedrive devices"),
        (
            "http://127.0.0.1:{port}/",
            "nothing answers at that port; see: livedrive devices --network",
        ),
        (
            f"http://{'a' * 64}.invalid/",
            "it cannot be opened; see: livedrive devices --network",
        ),
    ],
)
def test_a_missing_camera_is_told_in_plain_words(spec: str, told: str) -> None:
    """Red before: "[Errno 2] could not open port /dev/none: [Errno 2] No such file or ..."."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]  # closed from here on
    (camera,) = cameras([spec.replace("{port}", str(port))], MonotonicClock())
    with pytest.raises(CameraLostError) as error:
        camera._connect()  # noqa: SLF001
    assert str(error.value) == told


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (OSError(errno.EBUSY, "Device or resource busy"), "another program has it"),
        (PermissionError(errno.EACCES, "Permission denied"), "no permission to use it"),
        (socket.gaierror(-2, "Name or service not known"), "nobody knows a machine of that name"),
        (TimeoutError("timed out"), "no answer"),
        (ValueError("a library's own words"), "it cannot be opened"),
    ],
)
def test_every_failure_has_words(error: Exception, words: str) -> None:
    assert str(reasons.lost(error)) == f"{words}; see: livedrive devices"


def test_a_camera_that_is_pulled_out_is_told_with_what_to_type() -> None:
    """Red before: the driver failed: [Errno 19] No such device: '/dev/video0'."""

    def packets() -> Iterator[object]:
        raise OSError(errno.ENODEV, "No such device", "/dev/video0")
        yield

    link = DriverLink.__new__(DriverLink)
    link._packets, link._jpeg = packets(), True  # noqa: SLF001
    with pytest.raises(CameraLostError, match="it is not there; see: livedrive devices"):
        link.read(0.1)
    link._packets = iter(())  # noqa: SLF001
    with pytest.raises(CameraLostError, match="the driver failed; see: livedrive devices"):
        link.read(0.1)
