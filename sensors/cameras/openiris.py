"""OpenIris cameras on a serial port: `FF A0 FF A1`, length (u16, little endian), JPEG.

Flow: serial port -> Framing -> newest JPEG -> Shot. JSON replies to commands share the line, so
bytes between pictures are left out.
"""

from typing import Any

from sensors.cameras import reasons
from sensors.picture import JPEG_START, BadPictureError, JpegDecoder, Shot
from sensors.types import NS, Clock, InputError

BAUD = 3_000_000
MARK = b"\xff\xa0\xff\xa1"
HEAD_BYTES = len(MARK) + 2
MAX_GARBAGE = 1 << 17  # bytes without a picture; a quiet line is no reason to count damage


class Framing:
    """Bytes in, JPEGs out; memory stays below two pictures."""

    def __init__(self) -> None:
        self.garbage_bytes = 0
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[bytes]:
        self._buffer += data
        pictures: list[bytes] = []
        while (picture := self._next()) is not None:
            pictures.append(picture)
        return pictures

    def _next(self) -> bytes | None:
        buffer = self._buffer
        while True:
            start = buffer.find(MARK)
            if start < 0:
                self._drop(max(len(buffer) - len(MARK) + 1, 0))
                return None
            self._drop(start)
            if len(buffer) < HEAD_BYTES + len(JPEG_START):
                return None
            length = int.from_bytes(buffer[len(MARK) : HEAD_BYTES], "little")
            if not buffer.startswith(JPEG_START, HEAD_BYTES):
                self._drop(len(MARK))  # noise that looks like a mark
                continue
            later = buffer.find(MARK, HEAD_BYTES, HEAD_BYTES + length)
            if later >= 0:  # bytes went missing: the next picture starts inside this one
                self._drop(later)
                continue
            if len(buffer) < HEAD_BYTES + length:
                return None
            picture = bytes(buffer[HEAD_BYTES : HEAD_BYTES + length])
            del buffer[: HEAD_BYTES + length]
            return picture

    def _drop(self, num: int) -> None:
        self.garbage_bytes += num
        del self._buffer[:num]


class SerialLink:
    """An open serial port."""

    def __init__(self, port: str, clock: Clock) -> None:
        import serial

        self._clock, self._framing, self._decode = clock, Framing(), JpegDecoder()
        self._lost: tuple[type[Exception], ...] = (serial.SerialException, OSError, TypeError)
        try:
            self._port: Any = serial.Serial(port, BAUD, timeout=0.05, exclusive=True)
        except serial.SerialException as error:
            raise reasons.lost(error) from None
        except ValueError as error:
            raise InputError(f"serial:{port}: {error}; see: livedrive devices") from None

    def read(self, timeout_s: float) -> Shot | None:
        deadline_ns = self._clock.now_ns() + int(timeout_s * NS)
        while self._clock.now_ns() < deadline_ns:
            try:
                data = self._port.read(max(self._port.in_waiting, 1))
            except self._lost as error:
                raise reasons.lost(error, otherwise=f"serial port: {error}") from None
            pictures = self._framing.feed(data)
            if pictures:
                arrival_ns = self._clock.now_ns()
                return Shot(self._decode(pictures[-1]), arrival_ns, None, len(pictures) - 1)
            if self._framing.garbage_bytes > MAX_GARBAGE:
                self._framing.garbage_bytes = 0
                raise BadPictureError("expected JPEG pictures, got other bytes")
        return None

    def close(self) -> None:
        self._port.close()
