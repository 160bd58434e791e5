"""An OpenIris camera on a pseudo-terminal: a real serial line, as far as pyserial can tell."""

import os
import select
import sys
import threading
import time
from collections.abc import Sequence

import numpy as np

from sensors.cameras.openiris import MARK

REPLY = b'{"results":[{"command":"ping","result":"pong"}]}\r\n'


class SerialCamera:
    """Sends its film; `noise` mixes other bytes in, `unplug` takes the line away."""

    def __init__(self, pictures: Sequence[bytes], *, rate_hz: float = 30.0, seed: int = 0) -> None:
        self.pictures, self.rate_hz = list(pictures), rate_hz
        self.noise = False
        self.silent = False
        self.sent = 0
        self._rng = np.random.default_rng(seed)
        self._closing = threading.Event()
        self.port, self._master, self._slave = "", -1, -1
        self.plug()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def plug(self) -> None:
        if sys.platform == "win32":
            raise OSError("serial stand-in: expected pseudo-terminals, Windows has none")
        import tty

        self._master, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(self._master, False)
        self._slave, self.port = slave, os.ttyname(slave)

    def unplug(self) -> None:
        """The line is gone for good; `plug` makes another one under another name."""
        master, self._master = self._master, -1
        os.close(master)
        os.close(self._slave)

    def close(self) -> None:
        self._closing.set()
        self._thread.join()
        if self._master >= 0:
            self.unplug()

    def _run(self) -> None:
        while not self._closing.wait(1 / self.rate_hz):
            if self._master < 0 or self.silent:
                continue
            data = self.pictures[self.sent % len(self.pictures)]
            packet = MARK + len(data).to_bytes(2, "little") + data
            if self.sent % 10 == 0:
                packet = REPLY + packet
            if self.noise:
                packet = self._spoil(packet)
            self._write(packet)
            self.sent += 1

    def _spoil(self, packet: bytes) -> bytes:
        """Lose, change and add bytes."""
        spoiled = bytearray(packet)
        for at in self._rng.integers(0, len(spoiled), 20):
            spoiled[at] = self._rng.integers(256)
        cut = int(self._rng.integers(len(spoiled)))
        del spoiled[cut : cut + int(self._rng.integers(200))]
        return bytes(spoiled) + self._rng.bytes(int(self._rng.integers(100)))

    def _write(self, data: bytes) -> None:
        deadline = time.monotonic() + 1.0
        while data and self._master >= 0 and not self._closing.is_set():
            try:
                select.select([], [self._master], [], 0.05)
                data = data[os.write(self._master, data) :]
            except BlockingIOError:
                continue
            except (OSError, ValueError):
                return
            if time.monotonic() > deadline:
                return  # nobody reads
