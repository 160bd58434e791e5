"""UVC streaming: the negotiation block and the pictures cut into payloads, as plain bytes.

Flow: CameraDescription -> Probe -> device; bulk payloads -> Payloads -> (picture, device time).
"""

import struct
from dataclasses import dataclass

PROBE_BYTES = 26  # UVC 1.0; later versions add fields that may be left out
MAX_PAYLOAD = 1 << 20
FRAME_ID, END_OF_FRAME, HAS_PTS, ERROR = 0x01, 0x02, 0x04, 0x40  # header bits, 2.4.3.3


@dataclass(frozen=True)
class Probe:
    """The part of the video probe and commit controls (4.3.1.1) that matters here."""

    format_index: int
    frame_index: int
    interval: int  # 100 ns units
    max_frame: int = 0  # bytes, told by the device
    max_payload: int = 0

    def pack(self) -> bytes:
        head = struct.pack("<HBBI", 1, self.format_index, self.frame_index, self.interval)
        return head + bytes(10) + struct.pack("<II", self.max_frame, self.max_payload)

    @staticmethod
    def unpack(data: bytes) -> "Probe":
        if len(data) < PROBE_BYTES:
            raise ValueError(f"probe of {len(data)} bytes, expected {PROBE_BYTES}")
        _, format_index, frame_index, interval = struct.unpack_from("<HBBI", data)
        max_frame, max_payload = struct.unpack_from("<II", data, 18)
        return Probe(format_index, frame_index, interval, max_frame, max_payload)


@dataclass(frozen=True)
class Picture:
    data: bytes
    ticks: int | None  # presentation time on the device's clock, not unwrapped


class Payloads:
    """Puts pictures together. A picture with a lost or damaged payload is left out."""

    def __init__(self, max_frame: int) -> None:
        self.damaged = 0
        self._max_frame = max_frame
        self._data = bytearray()
        self._frame_id: int | None = None
        self._ticks: int | None = None
        self._bad = True  # until the first picture starts: this one may be half

    def feed(self, payload: bytes) -> Picture | None:
        """Take one payload, header first; return the picture that it completes."""
        if len(payload) < 2 or not 2 <= payload[0] <= len(payload):
            self._spoil()
            return None
        header, flags = payload[0], payload[1]
        done: Picture | None = None
        if self._frame_id is not None and flags & FRAME_ID != self._frame_id:
            done = self._finish()  # no end was marked, but a new picture has begun
        self._frame_id = flags & FRAME_ID
        if flags & HAS_PTS and header >= 6:
            self._ticks = struct.unpack_from("<I", payload, 2)[0]
        if flags & ERROR or len(self._data) + len(payload) - header > self._max_frame:
            self._spoil()
        elif not self._bad:
            self._data += payload[header:]
        if flags & END_OF_FRAME:
            done = self._finish()
            self._frame_id = None
        return done

    def _finish(self) -> Picture | None:
        bad, data, ticks = self._bad, bytes(self._data), self._ticks
        self._data.clear()
        self._bad, self._ticks = False, None
        return None if bad or not data else Picture(data, ticks)

    def _spoil(self) -> None:
        if not self._bad:
            self.damaged += 1
        self._bad = True
        self._data.clear()
