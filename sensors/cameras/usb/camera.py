"""UsbLink: a UVC camera on bulk transfers, opened by vendor and product.

Flow: find -> descriptors -> probe and commit -> bulk payloads -> Shot. pyusb has no hot-plug events
and no isochronous transfers: a camera that is gone is looked for again by EyeCamera.
"""

import errno
from collections.abc import Callable, Iterator
from contextlib import suppress
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sensors.cameras.usb.descriptors import CameraDescription, DescriptorError, FrameSize, parse
from sensors.cameras.usb.extension import (
    FROM_INTERFACE,
    GET_CUR,
    SET_CUR,
    TIMEOUT_MS,
    TO_INTERFACE,
    UNIT,
    ExtensionUnit,
    ViveTracker,
)
from sensors.cameras.usb.profiles import profile, udev_rule
from sensors.cameras.usb.streaming import MAX_PAYLOAD, Payloads, Picture, Probe
from sensors.picture import BadPictureError, CameraLostError, JpegDecoder, Shot
from sensors.types import NS, Clock, InputError

PROBE_CONTROL, COMMIT_CONTROL = 1, 2
CONFIGURATION = 2  # descriptor type
WRAP = 1 << 32  # presentation times are 32 bits
FOREIGN = "Windows has another driver for it; use its uvc: name, or give it WinUSB with Zadig"


class UsbLink:
    """An open camera; only one program can have it."""

    def __init__(self, vendor: int, product: int, clock: Clock, backend: Any = None) -> None:
        core, util = pyusb("core"), pyusb("util")
        self._clock, self._util = clock, util
        self._usb_error, self._usb_timeout = core.USBError, core.USBTimeoutError
        try:
            found = core.find(idVendor=vendor, idProduct=product, backend=backend)
        except core.NoBackendError:
            raise InputError(
                "usb: expected the libusb library, got none; run: apt-get install libusb-1.0-0"
            ) from None
        if found is None:
            device = f"{vendor:04x}:{product:04x}"
            raise CameraLostError(f"no USB device {device} is plugged in; see: livedrive devices")
        self._device, self._vive, self._detached = found, None, list[int]()
        try:
            self._open(vendor, product)
        except (core.USBError, DescriptorError, ValueError, NotImplementedError) as error:
            self.close()
            raise _lost(error, vendor, product) from None
        except CameraLostError:
            self.close()
            raise

    def read(self, timeout_s: float) -> Shot | None:
        deadline_ns = self._clock.now_ns() + int(timeout_s * NS)
        while (left_ns := deadline_ns - self._clock.now_ns()) > 0:
            try:
                timeout_ms = max(left_ns // 1_000_000, 1)
                payload = bytes(self._device.read(self._endpoint, self._max_payload, timeout_ms))
            except self._usb_timeout:
                return None
            except self._usb_error as error:
                raise CameraLostError(f"USB: {error}; plug it in again") from None
            damaged = self._payloads.damaged
            picture = self._payloads.feed(payload)
            if picture is not None:
                arrival_ns = self._clock.now_ns()
                image = self._decode(picture.data)
                return Shot(image, arrival_ns, self._device_ns(picture))
            if self._payloads.damaged > damaged:
                raise BadPictureError("a payload was damaged")
        return None

    def close(self) -> None:
        try:
            if self._vive is not None:
                self._vive.switch_off()
        except (self._usb_error, CameraLostError):
            pass  # it is gone already
        for interface in self._detached:
            with suppress(self._usb_error):
                self._util.release_interface(self._device, interface)
        for interface in self._detached:  # its driver takes both together, where nobody has one
            with suppress(self._usb_error):  # it has taken it, or the camera is gone
                self._device.attach_kernel_driver(interface)
        self._detached.clear()
        self._util.dispose_resources(self._device)

    def _open(self, vendor: int, product: int) -> None:
        camera = describe(self._device)
        for interface in (camera.control_interface, camera.streaming_interface):
            with suppress(NotImplementedError):  # not on Windows
                if self._device.is_kernel_driver_active(interface):
                    self._device.detach_kernel_driver(interface)
                    self._detached.append(interface)
        known = profile(vendor, product)
        if known is not None and known.vive_commands:
            self._vive = ViveTracker(ExtensionUnit(self._device, camera.control_interface, UNIT))
            self._vive.switch_on()
        self._frame = camera.best()
        agreed = self._negotiate(camera, self._frame)
        self._decode = decoder(self._frame)
        self._endpoint = camera.endpoint
        self._max_payload = min(agreed.max_payload or MAX_PAYLOAD, MAX_PAYLOAD)
        size = 4 * self._frame.width * self._frame.height + 4096
        self._payloads = Payloads(min(agreed.max_frame or size, size))
        self._clock_hz = camera.clock_hz
        self._ticks: int | None = None  # unwrapped

    def _negotiate(self, camera: CameraDescription, frame: FrameSize) -> Probe:
        wanted = Probe(frame.format_index, frame.frame_index, frame.interval).pack()
        self._control(SET_CUR, PROBE_CONTROL, camera, wanted)
        agreed = bytes(self._control(GET_CUR, PROBE_CONTROL, camera, len(wanted)))
        self._control(SET_CUR, COMMIT_CONTROL, camera, agreed)
        probe = Probe.unpack(agreed)
        if (probe.format_index, probe.frame_index) != (frame.format_index, frame.frame_index):
            raise ValueError("the camera insists on another picture size")
        return probe

    def _control(self, request: int, control: int, camera: CameraDescription, data: Any) -> Any:
        kind = FROM_INTERFACE if request == GET_CUR else TO_INTERFACE
        return self._device.ctrl_transfer(
            kind, request, control << 8, camera.streaming_interface, data, TIMEOUT_MS
        )

    def _device_ns(self, picture: Picture) -> int | None:
        """The presentation time in ns, without its wraps."""
        if picture.ticks is None or self._clock_hz == 0:
            return None
        last = picture.ticks if self._ticks is None else self._ticks
        self._ticks = last + (picture.ticks - last + WRAP // 2) % WRAP - WRAP // 2
        return self._ticks * NS // self._clock_hz


def pyusb(module: str) -> Any:
    """A module of pyusb, which has no types; imported when it is needed."""
    return import_module(f"usb.{module}")


def describe(device: Any) -> CameraDescription:
    """Read and parse the configuration of a pyusb device. Raises USBError, DescriptorError and,
    where Windows has another driver for it, NotImplementedError."""
    control = pyusb("control")
    head = bytes(control.get_descriptor(device, 9, CONFIGURATION, 0))
    total = int.from_bytes(head[2:4], "little")
    return parse(bytes(control.get_descriptor(device, max(total, 9), CONFIGURATION, 0)))


def decoder(frame: FrameSize) -> Callable[[bytes], NDArray[np.uint8]]:
    """What turns a picture of that kind into [H, W] brightness; it raises BadPictureError."""
    if frame.kind == "mjpeg":
        return JpegDecoder()
    pixel_bytes = 2 if frame.kind == "yuy2" else 1
    expected = frame.width * frame.height * pixel_bytes

    def pixels(data: bytes) -> NDArray[np.uint8]:
        if len(data) != expected:
            raise BadPictureError(f"picture of {len(data)} bytes, expected {expected}")
        return np.frombuffer(data, np.uint8)[::pixel_bytes].reshape(frame.height, frame.width)

    return pixels


def devices(backend: Any = None) -> Iterator[tuple[int, int, Any]]:
    """(vendor, product, pyusb device) of everything plugged in; nothing without libusb."""
    core = pyusb("core")
    try:
        found = core.find(find_all=True, backend=backend)
        for device in found or ():
            yield int(device.idVendor), int(device.idProduct), device
    except core.NoBackendError:
        return


def _lost(error: Exception, vendor: int, product: int) -> Exception:
    if getattr(error, "errno", None) == errno.EACCES:
        rule = udev_rule(vendor, product)
        place = "/etc/udev/rules.d/60-livedrive.rules"
        return CameraLostError(f"no permission; write this line to {place}: {rule}")
    if isinstance(error, NotImplementedError):
        return CameraLostError(FOREIGN)
    return error if isinstance(error, OSError) else CameraLostError(f"USB: {error}")
