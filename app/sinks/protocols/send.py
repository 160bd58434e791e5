"""`--send URL ...`: the face to other programs, over UDP, from a thread of its own.

    loop -> SendSink.on_frame -> queue (newest win) -> thread -> Receiver.send -> UDP

The loop only puts a frame into a queue. A program that is not there costs nothing and is met again
as soon as it listens.
"""

import contextlib
import queue
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from app.drive.sink import FrameResult, RunInfo
from app.sinks.protocols.face import Encoder, FaceReader, NamedFace
from encoder.types import DrivenFrame
from sensors.types import InputError

QUEUE = 30  # ticks; when the thread falls behind, the oldest is dropped
COSTS = 30 * 60 * 10  # the last ten minutes of ticks: what they cost is remembered
SURE = 3  # ticks without a refusal after which a receiver counts as met again
JOIN_S = 2.0
RENEW_S = 5.0  # between two questions what a receiver takes


@dataclass(frozen=True)
class Destination:
    """Where a face is sent, and in which words."""

    host: str
    port: int
    encode: Encoder


# Asks the receiver, which may take seconds; None: as before.
Renewed = Callable[[], Destination | None]


class Receiver:
    """One receiver. UDP asks nobody; that no one listens is heard only from this machine."""

    def __init__(self, url: str, place: Destination | None, renewed: Renewed | None = None) -> None:
        """place: None: not known yet, `renewed` will tell. Raises InputError at a host that cannot
        be found, or not be sent to."""
        self.url, self.renewed = url, renewed
        self.sent, self.lost, self.reconnects = 0, 0, 0  # ticks, ticks, times it was met again
        self._heard = SURE  # ticks since it was last refused
        self._cost_ns = np.full((COSTS, 2), 0, np.int64)  # wall, this thread's CPU; nothing grows
        self._socket: socket.socket | None = None
        self.encode: Encoder | None = None
        if place:
            self.turn(place)

    def turn(self, place: Destination) -> None:
        """From now on there, while another thread sends. Raises InputError as above."""
        before, self._socket = self._socket, self._connected(place)
        self.encode = place.encode
        if before:
            before.close()

    def send(self, face: NamedFace) -> None:
        start_ns, start_cpu_ns = time.perf_counter_ns(), time.thread_time_ns()
        datagrams = self.encode(face) if self.encode else []
        arrived = [self._post(datagram) for datagram in datagrams]
        if self.encode and all(arrived):
            self.sent += 1
            self._heard += 1
            self.reconnects += self._heard == SURE
        else:
            self.lost += 1
            self._heard = 0
        slot = (self.sent + self.lost - 1) % COSTS
        wall_ns = time.perf_counter_ns() - start_ns
        self._cost_ns[slot] = wall_ns, time.thread_time_ns() - start_cpu_ns

    def report(self) -> dict[str, Any]:
        count = max(min(self.sent + self.lost, COSTS), 1)  # nothing was sent: zeros
        wall_ms, cpu_ms = self._cost_ns[:count].T / 1e6
        costs = {
            "p50_ms": round(float(np.percentile(wall_ms, 50)), 3),
            "p99_ms": round(float(np.percentile(wall_ms, 99)), 3),
            "cpu_ms": round(float(cpu_ms.mean()), 3),
        }
        return {"sent": self.sent, "lost": self.lost, "reconnects": self.reconnects, **costs}

    def close(self) -> None:
        if self._socket:
            self._socket.close()

    def _connected(self, place: Destination) -> socket.socket:
        try:
            family, kind, protocol, _, address = socket.getaddrinfo(
                place.host, place.port, type=socket.SOCK_DGRAM
            )[0]
            made = socket.socket(family, kind, protocol)
            made.setblocking(False)
            made.connect(address)  # refused by the system: an address of many, or no way
        except (OSError, UnicodeError) as error:
            raise InputError(
                f"--send {self.url}: expected a host that can be sent to, got {error}; "
                "try 127.0.0.1"
            ) from error
        return made

    def _post(self, datagram: bytes) -> bool:
        """False: refused. The refusal is that of the last datagram, so this one goes out anyway."""
        assert self._socket
        try:
            self._socket.send(datagram)
            return True
        except OSError:  # nobody listens, no route, or a full buffer
            with contextlib.suppress(OSError):
                self._socket.send(datagram)
            return False


class SendSink:
    """Sends every tick to all receivers."""

    def __init__(self, reader: FaceReader) -> None:
        self.receivers: list[Receiver] = []  # filled before `on_start`
        self._reader = reader
        self._queue: queue.Queue[DrivenFrame | None] = queue.Queue(QUEUE)
        self.dropped = 0  # ticks that the queue had no room for
        self._thread = threading.Thread(target=self._run, name="send", daemon=True)
        self._closing = threading.Event()

    def on_start(self, info: RunInfo) -> None:
        self._thread.start()
        if any(receiver.renewed for receiver in self.receivers):
            threading.Thread(target=self._renew, name="send: renew", daemon=True).start()

    def on_frame(self, result: FrameResult) -> None:
        while True:
            try:
                self._queue.put_nowait(result.driven)
            except queue.Full:
                with contextlib.suppress(queue.Empty):
                    self._queue.get_nowait()
                    self.dropped += 1
            else:
                return

    def close(self) -> None:
        self._closing.set()
        if self._thread.is_alive():
            self._queue.put(None)
            self._thread.join(JOIN_S)
        for receiver in self.receivers:
            receiver.close()

    def network_report(self) -> dict[str, Any]:
        """{url: {sent, lost, reconnects, dropped, p50_ms, p99_ms, cpu_ms}}: ticks and costs."""
        return {t.url: {**t.report(), "dropped": self.dropped} for t in self.receivers}

    def _run(self) -> None:
        while (driven := self._queue.get()) is not None:
            face = self._reader(driven)
            for receiver in self.receivers:
                receiver.send(face)

    def _renew(self) -> None:
        while not self._closing.wait(RENEW_S):
            for receiver in self.receivers:
                place = receiver.renewed() if receiver.renewed else None
                if place and not self._closing.is_set():
                    with contextlib.suppress(InputError):  # gone again
                        receiver.turn(place)
