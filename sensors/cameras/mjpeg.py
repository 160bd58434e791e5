"""MjpegLink: an MJPEG camera over HTTP, with a reader of our own so that no picture is stale.

Flow: socket -> HttpBody -> Multipart -> newest JPEG -> Shot. OpenCV's reader hands out pictures
that are 1.4 s old after a pause and never notices a stall.
"""

import socket
from urllib.parse import urlsplit

from sensors.cameras import reasons
from sensors.cameras.multipart import HttpBody, Multipart, Part
from sensors.picture import BadPictureError, CameraLostError, JpegDecoder, Shot
from sensors.types import NS, Clock, InputError

CONNECT_S = 1.0
RECEIVE_BYTES = 1 << 18


def check_url(url: str) -> None:
    """Raise InputError unless a connection to this address can be tried."""
    try:
        parts = urlsplit(url)
        good = bool(parts.hostname) and (parts.port is None or parts.port > 0) and url.isascii()
    except ValueError:
        good = False
    if not good or any(c.isspace() or not c.isprintable() for c in url):
        raise InputError(
            f"--eyes: expected an address like http://192.168.1.20:81/, got {url!r}; check it"
        )


class MjpegLink:
    """One HTTP connection. The camera takes one client at a time, so close it before the next."""

    def __init__(self, url: str, clock: Clock) -> None:
        parts = urlsplit(url)
        self._clock, self._decode = clock, JpegDecoder()
        host, port = parts.hostname or "", parts.port or 80
        path = (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
        self._body, self._multipart = HttpBody(), None
        try:
            self._socket = socket.create_connection((host, port), CONNECT_S)
        except (OSError, UnicodeError) as error:  # a part of the name may be too long
            raise reasons.lost(error, reasons.LIST_NETWORK) from None
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        name = f"[{host}]" if ":" in host else host
        request = f"GET {path} HTTP/1.1\r\nHost: {name}:{port}\r\nConnection: close\r\n\r\n"
        self._socket.sendall(request.encode("latin-1", "replace"))

    def read(self, timeout_s: float) -> Shot | None:
        deadline_ns = self._clock.now_ns() + int(timeout_s * NS)
        while (left_ns := deadline_ns - self._clock.now_ns()) > 0:
            self._socket.settimeout(left_ns / NS)
            try:
                data = self._socket.recv(RECEIVE_BYTES)
            except TimeoutError:
                return None
            if not data:
                raise CameraLostError("the camera closed the connection")
            parts = self._parts(data)
            if parts:
                arrival_ns, newest = self._clock.now_ns(), parts[-1]
                image = self._decode(newest.data)
                return Shot(image, arrival_ns, newest.device_ns, len(parts) - 1)
            if self._multipart is not None and self._multipart.garbage_bytes > RECEIVE_BYTES:
                self._multipart.garbage_bytes = 0
                raise BadPictureError("expected JPEG pictures, got other bytes")
        return None

    def close(self) -> None:
        self._socket.close()

    def _parts(self, data: bytes) -> list[Part]:
        body = self._body.feed(data)
        if self._multipart is None:
            if not self._body.content_type:
                return []
            self._multipart = Multipart(self._body.content_type)
        return self._multipart.feed(body)
