"""Packets between two processes of a run: whole ones, and neither end ever waits.

Each packet goes as its length (u32) and its bytes over a stream socket, as Linux, macOS and Windows
all have one. When one end closes or dies, the other reads b"".
"""

import socket
import struct
import threading
from collections.abc import Iterator
from contextlib import suppress

HEAD = struct.Struct("<I")
MAX_PACKET = 1 << 16
BUFFER = 1 << 19  # bytes the system may hold for the other end
CLOSE_S = 1.0  # timeout for the rest of a packet


class Channel:
    """One end. Any thread may send; one at a time receives. What waits to be sent goes with the
    next packet either way."""

    def __init__(self, end: socket.socket) -> None:
        end.setblocking(False)
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER)
        self.socket = end
        self._incoming, self._outgoing = bytearray(), bytearray()
        self._lock = threading.Lock()

    def send(self, packet: bytes) -> None:
        """All of the packet or, with BlockingIOError where the other end is too slow, nothing.

        Raises another OSError where the other end is gone."""
        if len(packet) > MAX_PACKET:
            raise ValueError(f"packet: expected {MAX_PACKET} bytes at most, got {len(packet)}")
        with self._lock:
            self._flush()
            if self._outgoing:
                raise BlockingIOError
            data = HEAD.pack(len(packet)) + packet
            self._outgoing += data[self.socket.send(data) :]

    def insist(self, packet: bytes) -> None:
        """Send what must not be lost, and is rare: where the other end is too slow it waits here,
        before all that is sent later. Raises OSError where the other end is gone."""
        with self._lock:
            if self.socket.fileno() < 0:
                raise ConnectionError("closed")
            self._outgoing += HEAD.pack(len(packet)) + packet
            self._flush()

    def recv(self) -> bytes:
        """The next packet, b"" at the end; BlockingIOError where none has come yet."""
        with self._lock, suppress(OSError):  # what a partner sent who is gone is read all the same
            self._flush()
        while True:
            if len(self._incoming) >= HEAD.size:
                (size,) = HEAD.unpack_from(self._incoming)
                stop = HEAD.size + size
                if len(self._incoming) >= stop:
                    packet = bytes(self._incoming[HEAD.size : stop])
                    del self._incoming[:stop]
                    return packet
            try:
                data = self.socket.recv(MAX_PACKET)
            except ConnectionError:
                return b""
            if not data:
                return b""
            self._incoming += data

    def waiting(self) -> Iterator[bytes]:
        """Every packet that has come; b"" is the last one where the other end is gone."""
        packet = None
        while packet != b"":
            try:
                packet = self.recv()
            except BlockingIOError:
                return
            except OSError:
                packet = b""
            yield packet

    def fileno(self) -> int:
        return self.socket.fileno()

    def finish(self) -> None:
        """Send no more: the other end reads b"" after what was sent."""
        with self._lock:
            self._drain()
            self.socket.shutdown(socket.SHUT_WR)

    def close(self) -> None:
        with self._lock:
            self._drain()
            self.socket.close()

    def _flush(self) -> None:
        """What waits, as far as it goes."""
        if self._outgoing:
            with suppress(BlockingIOError):
                del self._outgoing[: self.socket.send(self._outgoing)]

    def _drain(self) -> None:
        if self._outgoing:
            try:
                self.socket.settimeout(CLOSE_S)
                self.socket.sendall(self._outgoing)
            except OSError:
                return
            finally:
                self._outgoing.clear()
                self.socket.setblocking(False)


def pair() -> tuple[Channel, Channel]:
    """Two connected ends."""
    ours, theirs = socket.socketpair()
    return Channel(ours), Channel(theirs)
