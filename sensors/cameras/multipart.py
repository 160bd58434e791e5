"""HTTP and multipart/x-mixed-replace without sockets: bytes in, JPEGs out.

Flow: MjpegLink -> HttpBody (head, chunked transfer) -> Multipart -> (JPEG, X-Timestamp).
Works from bytes alone, so that any split and any damage can be tested.
"""

import re
from dataclasses import dataclass

from sensors.picture import MAX_JPEG_BYTES, CameraLostError

MAX_HEAD_BYTES = 16_384
MAX_BUFFER = MAX_JPEG_BYTES + MAX_HEAD_BYTES
HEAD_END = b"\r\n\r\n"
CURE = "give the address of the camera's stream, often http://HOST:81/, not of its page"


class HttpBody:
    """Strips the response head and, where there is one, the chunked transfer coding."""

    def __init__(self) -> None:
        self.content_type = ""
        self._buffer = bytearray()
        self._in_head = True
        self._chunked = False
        self._left = 0  # bytes of the current chunk, its line end included

    def feed(self, data: bytes) -> bytes:
        """Body bytes. Raises CameraLostError if this is no picture stream."""
        self._buffer += data
        if self._in_head:
            if not self._head():
                return b""
            self._in_head = False
        if not self._chunked:
            body = bytes(self._buffer)
            self._buffer.clear()
            return body
        return self._dechunk()

    def _head(self) -> bool:
        end = self._buffer.find(HEAD_END)
        if end < 0:
            if len(self._buffer) > MAX_HEAD_BYTES:
                raise CameraLostError("the camera's HTTP response has no end of head")
            return False
        status, *lines = bytes(self._buffer[:end]).decode("latin-1").split("\r\n")
        del self._buffer[: end + len(HEAD_END)]
        if not re.match(r"HTTP/1\.[01] 200\b", status):
            raise CameraLostError(f"expected HTTP status 200, got {status[:60]!r}; {CURE}")
        fields = _fields(lines)
        self.content_type = fields.get("content-type", "")
        if "multipart" not in self.content_type.lower():
            got = f"{self.content_type[:60]!r}"
            raise CameraLostError(f"expected multipart pictures, got {got}; {CURE}")
        self._chunked = "chunked" in fields.get("transfer-encoding", "").lower()
        return True

    def _dechunk(self) -> bytes:
        body, buffer = bytearray(), self._buffer
        while buffer:
            if self._left > 2:
                piece = buffer[: self._left - 2]
                body += piece
                del buffer[: len(piece)]
                self._left -= len(piece)
                continue
            if self._left:  # the line end after a chunk
                del buffer[:1]
                self._left -= 1
                continue
            end = buffer.find(b"\r\n")
            if end < 0:
                if len(buffer) > 64:
                    raise CameraLostError("damaged chunk in the camera's HTTP response")
                break
            size = bytes(buffer[:end]).split(b";")[0].strip()
            if not re.fullmatch(rb"[0-9a-fA-F]{1,7}", size) or int(size, 16) == 0:
                raise CameraLostError("the camera ended its HTTP response")
            del buffer[: end + 2]
            self._left = int(size, 16) + 2
        return bytes(body)


@dataclass(frozen=True)
class Part:
    """One body part of the stream."""

    data: bytes
    device_ns: int | None  # from X-Timestamp


class Multipart:
    """Finds the parts between boundaries; what lies between them is counted and left out."""

    def __init__(self, content_type: str) -> None:
        match = re.search(r'boundary="?([^";]+)', content_type)
        name = match.group(1).strip() if match else ""
        self.garbage_bytes = 0
        # Some cameras announce "--name" and then write it as it stands.
        self._boundary = b"--" + name.removeprefix("--").encode("latin-1", "replace")
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[Part]:
        """The parts completed by `data`. Memory stays below one largest picture."""
        self._buffer += data
        parts: list[Part] = []
        while (part := self._next()) is not None:
            parts.append(part)
        if len(self._buffer) > MAX_BUFFER:
            self.garbage_bytes += len(self._buffer)
            self._buffer.clear()
        return parts

    def _next(self) -> Part | None:
        buffer = self._buffer
        while True:
            start = buffer.find(self._boundary)
            if start < 0:
                keep = len(self._boundary) - 1
                extra = max(len(buffer) - keep, 0)
                self.garbage_bytes += extra
                del buffer[:extra]
                return None
            self.garbage_bytes += max(start - 2, 0)
            del buffer[:start]
            head_end = buffer.find(HEAD_END, 0, MAX_HEAD_BYTES)
            if head_end < 0:
                if len(buffer) < MAX_HEAD_BYTES:
                    return None
                self._skip_boundary()
                continue
            head = bytes(buffer[len(self._boundary) : head_end]).decode("latin-1")
            fields = _fields(head.split("\r\n"))
            end = self._body_end(head_end + len(HEAD_END), fields.get("content-length", ""))
            if end is None:
                return None
            if end < 0:
                self._skip_boundary()
                continue
            data = bytes(buffer[head_end + len(HEAD_END) : end])
            del buffer[:end]
            return Part(data, _timestamp_ns(fields.get("x-timestamp", "")))

    def _body_end(self, start: int, length: str) -> int | None:
        """Where the body ends: None if it is not all here, -1 if the head makes no sense."""
        if length:
            if not re.fullmatch(r"\d{1,8}", length) or int(length) > MAX_JPEG_BYTES:
                return -1
            end = start + int(length)
            return end if len(self._buffer) >= end else None
        end = self._buffer.find(self._boundary, start)
        return None if end < 0 else end

    def _skip_boundary(self) -> None:
        self.garbage_bytes += len(self._boundary)
        del self._buffer[: len(self._boundary)]


def _fields(lines: list[str]) -> dict[str, str]:
    pairs = (line.split(":", 1) for line in lines if ":" in line)
    return {name.strip().lower(): value.strip() for name, value in pairs}


def _timestamp_ns(text: str) -> int | None:
    """OpenIris and the ESP32 examples write seconds.microseconds."""
    match = re.fullmatch(r"(\d{1,12})(?:\.(\d{1,9}))?", text)
    if match is None:
        return None
    return int(match.group(1)) * 1_000_000_000 + int((match.group(2) or "").ljust(9, "0"))
