"""USB cameras through pyusb and a backend that speaks the protocol: stream, damage, unplugging."""

import errno
import shutil
import struct
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from cameras_material import Start, collect, opening
from usb.core import USBError
from waiting import wait_until

from sensors.cameras.discovery import found_devices
from sensors.cameras.usb.camera import UsbLink
from sensors.cameras.usb.descriptors import DescriptorError, parse
from sensors.cameras.usb.extension import register
from sensors.cameras.usb.streaming import END_OF_FRAME, ERROR, HAS_PTS, Payloads, Probe
from sensors.clock import MonotonicClock
from sensors.picture import CameraLostError, JpegDecoder
from sensors.standins.eye_pictures import film
from sensors.standins.usb_camera import UsbCamera
from sensors.standins.usb_descriptors import configuration_descriptor

FILM = film(8, 800, 400)
BEYOND = "usb:35bd:0202"
UMOCKDEV = """P: /devices/pci0000:00/0000:00:14.0/usb1/1-1
N: bus/usb/001/002
E: BUSNUM=001
E: DEVNAME=/dev/bus/usb/001/002
E: DEVNUM=002
E: DEVTYPE=usb_device
E: SUBSYSTEM=usb
A: bConfigurationValue=1\\n
A: bNumConfigurations=1\\n
A: busnum=1\\n
A: devnum=2\\n
A: idProduct=0202\\n
A: idVendor=35bd\\n
A: speed=480\\n
"""


@pytest.fixture
def start() -> Iterator[Start]:
    with opening() as start:
        yield start


def test_both_eyes_of_a_side_by_side_camera(start: Start) -> None:
    packets = collect(start(BEYOND, UsbCamera(FILM, rate_hz=60)), 40)
    whole = [JpegDecoder()(data) for data in FILM]
    for eye in (0, 1):
        sent = {image[:, 400 * eye : 400 * eye + 400].tobytes() for image in whole}
        assert {p.image.tobytes() for p in packets if p.eye == eye} <= sent
    times = [p.t_ns for p in packets if p.eye == 0]
    assert times == sorted(set(times))


def test_damaged_payloads_cost_their_picture_only(start: Start) -> None:
    backend = UsbCamera(FILM, rate_hz=120)
    camera = start(BEYOND, backend)
    collect(camera, 4)
    backend.fault = "payloads"
    wait_until(lambda: camera.counts.damaged > 20, "damage")
    backend.fault = ""
    sent = {JpegDecoder()(data)[:, :400].tobytes() for data in FILM}
    seen = [p for p in camera.poll() + collect(camera, 40) if p.eye == 0]
    assert {p.image.tobytes() for p in seen} <= sent


@pytest.mark.slow
def test_unplugged_and_plugged_in_again(start: Start) -> None:
    backend = UsbCamera(FILM, rate_hz=60)
    camera = start(BEYOND, backend)
    collect(camera, 4)
    backend.plugged = False
    wait_until(lambda: "is plugged in; see: livedrive devices" in camera.problem, "the loss")
    camera.poll()
    backend.plugged = True
    collect(camera, 4)
    assert camera.counts.connects == 2
    backend.fault = "silent"
    wait_until(lambda: "no picture" in camera.problem, "the stall")


def test_without_permission_the_udev_rule_is_told(start: Start) -> None:
    backend = UsbCamera(FILM)
    backend.fault = "forbidden"
    camera = start(BEYOND, backend)
    wait_until(lambda: "udev" in camera.problem, "the rule")
    assert 'ATTR{idVendor}=="35bd"' in camera.problem
    (found,) = [d for d in found_devices(backend) if d.kind == "usb"]
    assert "/etc/udev/rules.d/" in found.problem
    assert found.spec == BEYOND


class OnWindows(UsbCamera):
    """libusb there knows of no drivers to detach, and opens no device that has another one."""

    foreign = False

    def __init__(self) -> None:
        super().__init__(FILM, rate_hz=60)
        self.kernel_drives = set()

    def is_kernel_driver_active(self, dev_handle: object, intf: int) -> bool:
        raise NotImplementedError

    def open_device(self, dev: object) -> str:
        if self.foreign:
            raise NotImplementedError
        return super().open_device(dev)


class OnLinux(UsbCamera):
    """Its kernel's driver takes both interfaces of a camera, and none that a program has."""

    claimed: frozenset[int] = frozenset()

    def claim_interface(self, dev_handle, intf: int) -> None:
        super().claim_interface(dev_handle, intf)
        self.claimed |= {intf}

    def release_interface(self, dev_handle, intf: int) -> None:
        super().release_interface(dev_handle, intf)
        self.claimed -= {intf}

    def attach_kernel_driver(self, dev_handle, intf: int) -> None:
        if self.claimed or intf in self.kernel_drives:
            raise USBError("Resource busy", -6, errno.EBUSY)
        for each in (0, 1):
            super().attach_kernel_driver(dev_handle, each)


def test_a_closed_camera_is_given_back_to_its_driver() -> None:
    """Red before: no other program saw it until it was plugged in again."""
    backend = OnLinux(FILM)
    for _ in range(2):
        link = UsbLink(0x35BD, 0x0202, MonotonicClock(), backend)
        assert backend.kernel_drives == set()
        wait_until(lambda link=link: link.read(1.0) is not None, "a picture")
        link.close()
        assert backend.kernel_drives == {0, 1}
        link.close()


def test_windows_has_no_driver_to_detach(start: Start) -> None:
    """Red before: the camera's thread ended without a word."""
    assert collect(start(BEYOND, OnWindows()), 4)


def test_windows_with_another_driver_is_told(start: Start) -> None:
    """Red before: `livedrive devices` ended, and a camera's thread."""
    backend = OnWindows()
    backend.foreign = True
    camera = start(BEYOND, backend)
    wait_until(lambda: "WinUSB" in camera.problem, "the reason")
    (found,) = [d for d in found_devices(backend) if d.kind == "usb"]
    assert "WinUSB" in found.problem


def test_devices_name_the_likely_headset() -> None:
    (found,) = [d for d in found_devices(UsbCamera(FILM)) if d.kind == "usb"]
    assert "Bigscreen" in found.headset
    assert found.detail == "800 x 400 mjpeg, 30 Hz"
    assert found.problem == ""


@pytest.mark.slow
def test_the_vive_tracker_is_switched_on_and_off() -> None:
    backend = UsbCamera(
        film(4), vendor=0x0BB4, product=0x0321, width=400, needs_switch=True, rate_hz=60
    )
    link = UsbLink(0x0BB4, 0x0321, MonotonicClock(), backend)
    assert backend.streaming and backend.infrared
    assert backend.registers[0x05] == 0xB2
    shots = []
    wait_until(lambda: bool(shots.append(link.read(1.0)) or shots[-1] is not None), "a picture")
    assert shots[-1].image.shape == (400, 400)
    link.close()
    assert not backend.streaming
    assert not backend.infrared
    link.close()


def test_register_commands_have_the_trackers_layout() -> None:
    command = register(0xAB, 0x05, 0xB2)
    assert command == bytes.fromhex("50ab600101 00000005 90010001 000000b2")


def test_a_device_that_is_not_there_is_told() -> None:
    with pytest.raises(CameraLostError, match="1234:5678"):
        UsbLink(0x1234, 0x5678, MonotonicClock(), UsbCamera(FILM))


def test_descriptors_of_isochronous_and_foreign_devices_are_refused() -> None:
    data = configuration_descriptor(800, 400, 90)
    camera = parse(data)
    assert (camera.endpoint, camera.streaming_interface, camera.extension_units) == (0x81, 1, [4])
    assert camera.clock_hz == 1_000_000
    best = camera.best()
    assert (best.width, best.height, best.kind, best.interval) == (800, 400, "mjpeg", 111_111)
    endpoint = data[-7:]
    with pytest.raises(DescriptorError, match="uvc:0"):
        parse(data[:-7] + endpoint[:3] + bytes([1]) + endpoint[4:])
    with pytest.raises(DescriptorError, match="no UVC video"):
        parse(data[:18])


def test_real_libusb_finds_a_device_that_umockdev_plugs_in(tmp_path: Path) -> None:
    """Enumeration and descriptors go through libusb itself; only the kernel is a stand-in."""
    runner = shutil.which("umockdev-run")
    if runner is None:
        pytest.skip("umockdev is not installed")
    device = struct.pack("<BBHBBBBHHHBBBB", 18, 1, 512, 239, 2, 1, 64, 0x35BD, 0x202, 1, 0, 0, 0, 1)
    descriptors = (device + configuration_descriptor(800, 400, 30)).hex().upper()
    plan = tmp_path / "camera.umockdev"
    plan.write_text(UMOCKDEV + f"H: descriptors={descriptors}\n\n")
    code = "from sensors.cameras.discovery import found_devices\n"
    code += "for device in found_devices(): print(device.spec, device.name)"
    done = subprocess.run(
        [runner, "--device", str(plan), "--", sys.executable, "-c", code],
        cwd=Path(__file__).parents[3],
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.stdout.strip() == f"{BEYOND} Bigscreen Beyond 2e eye tracker", done.stderr


def test_probe_round_trip() -> None:
    probe = Probe.unpack(Probe(2, 3, 333_333, 1000, 2000).pack())
    assert probe == Probe(2, 3, 333_333, 1000, 2000)
    with pytest.raises(ValueError, match="26"):
        Probe.unpack(bytes(10))


def payload(data: bytes, flags: int, ticks: int = 7) -> bytes:
    return struct.pack("<BBI", 6, flags | HAS_PTS, ticks) + data


def test_payloads_become_pictures_by_end_mark_or_by_frame_id() -> None:
    payloads = Payloads(100)
    assert payloads.feed(payload(b"half", 0)) is None  # we came in the middle
    assert payloads.feed(payload(b"", END_OF_FRAME)) is None
    assert payloads.feed(payload(b"ab", 1)) is None
    whole = payloads.feed(payload(b"cd", 1 | END_OF_FRAME))
    assert whole is not None
    assert (whole.data, whole.ticks) == (b"abcd", 7)
    assert payloads.feed(payload(b"ef", 0)) is None  # its end never comes
    other = payloads.feed(payload(b"gh", 1))
    assert other is not None
    assert other.data == b"ef"


@pytest.mark.parametrize("bad", [b"", b"\x09\x00ab", payload(b"x", ERROR), payload(bytes(200), 0)])
def test_a_damaged_payload_spoils_its_picture_and_no_other(bad: bytes) -> None:
    payloads = Payloads(100)
    payloads.feed(payload(b"", END_OF_FRAME))
    payloads.feed(payload(b"ab", 0))
    payloads.feed(bad)
    assert payloads.feed(payload(b"cd", END_OF_FRAME)) is None
    assert payloads.damaged == 1
    whole = payloads.feed(payload(b"good", 1 | END_OF_FRAME))
    assert whole is not None
    assert whole.data == b"good"
