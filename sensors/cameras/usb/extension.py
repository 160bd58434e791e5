"""Vendor commands through a UVC extension unit: switching the VIVE Facial Tracker on and off.

Flow: UsbLink (open, close) -> ViveTracker -> control transfers. The tracker answers 0x55 while a
command runs and 0x56 with an echo of it when it is done.
"""

import time
from collections.abc import Callable, Sequence
from typing import Any

from sensors.picture import CameraLostError

SET_CUR, GET_CUR, GET_LEN = 0x01, 0x81, 0x85
TO_INTERFACE, FROM_INTERFACE = 0x21, 0xA1  # class requests
TIMEOUT_MS = 500

UNIT, SELECTOR, LENGTH = 4, 2, 384
BUSY, DONE = 0x55, 0x56
SET, SENSOR, SYSTEM, STREAM = 0x50, 0xAB, 0xA2, 0x14
WAKE = bytes([0x51, 0x52]) + bytes(252) + bytes([0x53, 0x54])
# Exposure and gain of the two OV6211 sensors, as the tracker's own software sets them.
SENSOR_SETUP = (
    *((0x00, 0x40), (0x08, 0x01), (0x70, 0x00), (0x02, 0xFF), (0x03, 0xFF), (0x04, 0xFF)),
    *((0x0E, 0x00), (0x05, 0xB2), (0x06, 0xB2), (0x07, 0xB2), (0x0F, 0x03)),
)
IR_REGISTER, IR_ON, IR_OFF = 0x2246, 0x11, 0x03
SETTLE_S = 0.25
COMMAND_S = 0.5


class ExtensionUnit:
    """Reads and writes the controls of one unit."""

    def __init__(self, device: Any, interface: int, unit: int) -> None:
        self._device, self._index = device, unit << 8 | interface

    def length(self, selector: int) -> int:
        data = self._get(GET_LEN, selector, 2)
        return int.from_bytes(data, "little")

    def get(self, selector: int, length: int) -> bytes:
        return self._get(GET_CUR, selector, length)

    def set(self, selector: int, data: bytes) -> None:
        self._device.ctrl_transfer(
            TO_INTERFACE, SET_CUR, selector << 8, self._index, data, TIMEOUT_MS
        )

    def _get(self, request: int, selector: int, length: int) -> bytes:
        got: Sequence[int] = self._device.ctrl_transfer(
            FROM_INTERFACE, request, selector << 8, self._index, length, TIMEOUT_MS
        )
        return bytes(got)


class ViveTracker:
    """The command set of 0bb4:0321, from what is publicly known; not tried on a real one."""

    def __init__(self, unit: ExtensionUnit, sleep: Callable[[float], None] = time.sleep) -> None:
        self._unit, self._sleep = unit, sleep
        length = unit.length(SELECTOR)
        if length != LENGTH:
            raise CameraLostError(f"expected a control of {LENGTH} bytes, got {length}")

    def switch_on(self) -> None:
        self._stream(False)
        self._command(WAKE)
        for address, value in SENSOR_SETUP:
            self._command(register(SENSOR, address, value))
        self._stream(True)
        self.infrared(True)

    def switch_off(self) -> None:
        self.infrared(False)
        self._stream(False)

    def infrared(self, on: bool) -> None:
        """The light that the cameras need."""
        value = IR_ON if on else IR_OFF
        head = bytes([SET, SYSTEM, 0, 4, 1, 0x80, 0x18]) + IR_REGISTER.to_bytes(2, "big")
        self._send(head + bytes([0, 1]) + bytes(5) + bytes([value]))

    def _stream(self, on: bool) -> None:
        self._command(WAKE)
        self._send(bytes([SET, STREAM, 0, int(on)]))
        self._sleep(SETTLE_S)

    def _send(self, command: bytes) -> None:
        self._unit.set(SELECTOR, command.ljust(LENGTH, b"\0"))

    def _command(self, command: bytes) -> None:
        """Send and wait until the tracker has done it."""
        self._send(command)
        for _ in range(int(COMMAND_S / 0.005)):
            reply = self._unit.get(SELECTOR, LENGTH)
            if reply[:1] == bytes([DONE]) and reply[1:17] == command.ljust(16, b"\0")[:16]:
                return
            if reply[:1] != bytes([BUSY]):
                raise CameraLostError(f"the tracker refused a command: {reply[:4].hex()}")
            self._sleep(0.005)
        raise CameraLostError("the tracker does not finish a command")


def register(kind: int, address: int, value: int) -> bytes:
    """The command that sets one register."""
    head = bytes([SET, kind, 0x60, 1, 1]) + address.to_bytes(4, "big")
    return head + bytes([0x90, 0x01, 0x00, 0x01]) + value.to_bytes(4, "big")
