"""A UVC camera behind pyusb: a backend that enumerates, answers requests and streams payloads.

Flow: UsbLink -> pyusb -> UsbCamera (in place of libusb). It keeps the rules of the USB and UVC
specifications, so a request that a real camera would stall on fails here too.
"""

# pyright: reportMissingTypeStubs=false
import errno
import struct
import threading
import time
from collections.abc import Iterator, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import usb.backend
from usb.core import USBError, USBTimeoutError

from sensors.cameras.usb.extension import (
    BUSY,
    DONE,
    LENGTH,
    SELECTOR,
    SENSOR,
    SET,
    STREAM,
    SYSTEM,
    UNIT,
)
from sensors.cameras.usb.streaming import END_OF_FRAME, ERROR, HAS_PTS, PROBE_BYTES
from sensors.standins.usb_descriptors import (
    CLOCK_HZ,
    CONFIGURATION_FIELDS,
    DEVICE_FIELDS,
    ENDPOINT,
    ENDPOINT_FIELDS,
    INTERFACE_FIELDS,
    configuration_descriptor,
)
from sensors.types import NS

MAX_PAYLOAD, HEADER_BYTES = 16_384, 12
Backend: Any = usb.backend.IBackend  # without types


class UsbCamera(Backend):
    """One camera on a bus of its own. `fault`: "", payloads, silent, forbidden."""

    def __init__(
        self,
        pictures: Sequence[bytes],  # JPEGs
        *,
        vendor: int = 0x35BD,
        product: int = 0x0202,
        width: int = 800,
        height: int = 400,
        rate_hz: float = 30.0,
        needs_switch: bool = False,  # a VIVE tracker, silent until told to stream
        seed: int = 0,
    ) -> None:
        self.pictures, self.rate_hz = list(pictures), rate_hz
        self.vendor, self.product = vendor, product
        self.plugged, self.committed, self.fault = True, False, ""
        self.streaming, self.infrared = not needs_switch, False
        self.registers: dict[int, int] = {}
        self.configuration = configuration_descriptor(width, height, self.rate_hz)
        self._probe = bytes(PROBE_BYTES)
        self._reply, self.kernel_drives = bytes(LENGTH), {0, 1}
        self._payloads: Iterator[bytes] = iter(())
        self._rng = np.random.default_rng(seed)
        self._lock = threading.Lock()

    # What pyusb asks before it opens a device.

    def enumerate_devices(self) -> Iterator[int]:
        return iter([1] if self.plugged else [])

    def get_device_descriptor(self, dev: Any) -> Any:
        values = (18, 1, 0x0200, 0xEF, 2, 1, 64, self.vendor, self.product, 0x0100, 0, 0, 0, 1)
        fields = dict(zip(DEVICE_FIELDS.split(), values, strict=True))
        return SimpleNamespace(
            **fields, address=1, bus=1, port_number=1, port_numbers=(1,), speed=3
        )

    def get_configuration_descriptor(self, dev: Any, config: int) -> Any:
        return self._describe(2, 0, "<BBHBBBBB", CONFIGURATION_FIELDS)

    def get_interface_descriptor(self, dev: Any, intf: int, alt: int, config: int) -> Any:
        if alt:
            raise IndexError(alt)
        return self._describe(4, intf, "<BBBBBBBBB", INTERFACE_FIELDS)

    def get_endpoint_descriptor(self, dev: Any, ep: int, intf: int, alt: int, config: int) -> Any:
        found = self._describe(5, 0, "<BBBBHB", ENDPOINT_FIELDS)
        found.bRefresh = found.bSynchAddress = 0
        return found

    # What pyusb does with an open one.

    def open_device(self, dev: Any) -> str:
        self._check()
        if self.fault == "forbidden":
            raise USBError("Access denied (insufficient permissions)", -3, errno.EACCES)
        self._payloads = self._stream()
        return "handle"

    def close_device(self, dev_handle: Any) -> None:
        self.committed = False

    def set_configuration(self, dev_handle: Any, config_value: int) -> None:
        self._check()

    def get_configuration(self, dev_handle: Any) -> int:
        return 1

    def claim_interface(self, dev_handle: Any, intf: int) -> None:
        self._check()
        if intf in self.kernel_drives:
            raise USBError("Resource busy", -6, errno.EBUSY)

    def release_interface(self, dev_handle: Any, intf: int) -> None:
        self._check()

    def is_kernel_driver_active(self, dev_handle: Any, intf: int) -> bool:
        self._check()
        return intf in self.kernel_drives

    def detach_kernel_driver(self, dev_handle: Any, intf: int) -> None:
        self.kernel_drives.discard(intf)

    def attach_kernel_driver(self, dev_handle: Any, intf: int) -> None:
        self._check()
        self.kernel_drives.add(intf)

    def ctrl_transfer(
        self,
        dev_handle: Any,
        bmRequestType: int,  # noqa: N803  # pyusb's names
        bRequest: int,  # noqa: N803
        wValue: int,  # noqa: N803
        wIndex: int,  # noqa: N803
        data: Any,
        timeout: int,
    ) -> int:
        self._check()
        kind, request, value, index = bmRequestType, bRequest, wValue, wIndex
        if (kind, request, value) == (0x80, 6, 0x0200):
            return _answer(data, self.configuration)
        unit, interface = index >> 8, index & 0xFF
        if unit == 0 and interface == 1 and value in (0x0100, 0x0200):
            return self._video_control(request, value >> 8, data)
        if unit == UNIT and interface == 0 and value == SELECTOR << 8:
            return self._extension(request, data)
        raise USBError("Pipe error", -9, errno.EPIPE)

    def bulk_read(self, dev_handle: Any, ep: int, intf: int, buff: Any, timeout: int) -> int:
        self._check()
        if ep != ENDPOINT or not self.committed:
            raise USBError("Pipe error", -9, errno.EPIPE)
        deadline = time.monotonic() + timeout / 1000
        while not self.streaming or self.fault == "silent":
            self._check()
            if time.monotonic() > deadline:
                raise USBTimeoutError("Operation timed out", -7, errno.ETIMEDOUT)
            time.sleep(0.005)
        with self._lock:
            payload = next(self._payloads)
        self._check()
        return _answer(buff, payload)

    def _check(self) -> None:
        if not self.plugged:
            raise USBError("No such device (it may have been disconnected)", -4, errno.ENODEV)

    def _describe(self, kind: int, number: int, layout: str, names: str) -> Any:
        """Descriptor `number` of that type, as pyusb wants to see it."""
        at, found = 0, -1
        while at < len(self.configuration):
            found += self.configuration[at + 1] == kind
            if found == number:
                values = struct.unpack_from(layout, self.configuration, at)
                fields = dict(zip(names.split(), values, strict=True))
                return SimpleNamespace(**fields, extra_descriptors=[])
            at += self.configuration[at]
        raise IndexError(number)

    def _video_control(self, request: int, control: int, data: Any) -> int:
        if request == 0x01:
            wanted = bytes(data)
            format_index, frame_index = wanted[2], wanted[3]
            if (format_index, frame_index) != (1, 1):
                raise USBError("Pipe error", -9, errno.EPIPE)
            largest = 2 * max(map(len, self.pictures))
            self._probe = wanted[:18] + struct.pack("<II", largest, MAX_PAYLOAD)
            self.committed = control == 2
            return len(wanted)
        return _answer(data, self._probe)

    def _extension(self, request: int, data: Any) -> int:
        """The VIVE tracker's commands: busy once, then done with an echo."""
        if request == 0x85:
            return _answer(data, LENGTH.to_bytes(2, "little"))
        if request == 0x81:
            reply = self._reply
            self._reply = bytes([DONE]) + reply[1:]
            return _answer(data, reply)
        command = bytes(data)
        if command[:2] == bytes([SET, STREAM]):
            self.streaming = bool(command[3])
        elif command[:2] == bytes([SET, SYSTEM]):
            self.infrared = command[16] == 0x11
        elif command[:2] == bytes([SET, SENSOR]):
            self.registers[command[8]] = command[16]
        self._reply = bytes([BUSY]) + command[: LENGTH - 1]
        return len(command)

    def _stream(self) -> Iterator[bytes]:
        """Payloads at the camera's pace, without end."""
        start_ns, k = time.monotonic_ns(), 0
        while True:
            k += 1
            due_ns = start_ns + int(k * NS / self.rate_hz)
            time.sleep(max(due_ns - time.monotonic_ns(), 0) / NS)
            data, room = self.pictures[k % len(self.pictures)], MAX_PAYLOAD - HEADER_BYTES
            ticks = due_ns * CLOCK_HZ // NS % (1 << 32)
            for at in range(0, len(data), room):
                end = END_OF_FRAME if at + room >= len(data) else 0
                flags = 0x80 | HAS_PTS | 0x08 | end | k & 1
                header = struct.pack("<BBIIH", HEADER_BYTES, flags, ticks, ticks, 0)
                yield self._spoil(header + data[at : at + room])

    def _spoil(self, payload: bytes) -> bytes:
        if self.fault != "payloads" or self._rng.random() < 0.3:
            return payload
        kind = self._rng.integers(4)
        if kind == 0:
            return b""
        if kind == 1:
            return payload[: int(self._rng.integers(len(payload)))]
        if kind == 2:
            return bytes([payload[0], payload[1] | ERROR]) + payload[2:]
        return self._rng.bytes(len(payload))


def _answer(buffer: Any, data: bytes) -> int:
    """Fill pyusb's array with as much as fits; return how much."""
    num = min(len(buffer), len(data))
    buffer[:num] = type(buffer)("B", data[:num])
    return num
