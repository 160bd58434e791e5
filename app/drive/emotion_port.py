"""Emotions from other programs: OSC messages over UDP, heard beside the tick.

    datagram -> messages (sensors/osc.py) -> words -> check -> the newest, which the panel takes

Anybody who reaches the port may send anything.
"""

import contextlib
import socket
import sys
import threading
from collections import deque
from collections.abc import Callable
from typing import Any

from sensors import osc
from sensors.listening import cannot_listen
from sensors.types import InputError

ADDRESS = "/livedrive/emotion"
MAX_DATAGRAM = 1024  # bytes
PAUSE_S = 0.002  # after each datagram: a flood costs the tick little
LOOK_S = 0.2  # how often the thread looks whether it shall end
MAX_TOLD = 20  # bad messages of a run that are printed


class OscPort:
    """Listens for OSC messages `/livedrive/emotion happy:0.7`, or `happy 0.7`."""

    def __init__(self, host: str, port: int, check: Callable[[str], None]) -> None:
        """`check` raises InputError at words that cannot be shown; they are told and left."""
        self._check, self._told = check, 0
        self._newest: deque[str] = deque(maxlen=1)
        self._closed = threading.Event()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.settimeout(LOOK_S)
        try:
            self._socket.bind((host, port))
        except (OSError, OverflowError) as error:
            self._socket.close()
            raise cannot_listen("--listen", host, port, error) from None
        self._thread = threading.Thread(target=self._listen, name="emotion port", daemon=True)
        self._thread.start()

    @property
    def port(self) -> int:
        return int(self._socket.getsockname()[1])

    def picks(self) -> dict[str, Any]:
        """The emotion in the newest good words since the last call; never waits."""
        with contextlib.suppress(IndexError):
            return {"emotion": self._newest.pop()}
        return {}

    def show(self, changed: dict[str, Any]) -> None:
        """Nothing is shown here: nobody asks."""

    def close(self) -> None:
        self._closed.set()
        self._thread.join()
        self._socket.close()

    def _listen(self) -> None:
        while not self._closed.wait(PAUSE_S):
            try:
                datagram = self._socket.recv(MAX_DATAGRAM + 1)
            except OSError:  # nothing came; or Windows tells of a datagram that was too long
                continue
            words = words_in(datagram)
            if words is not None and self._is_good(words):
                self._newest.append(words)

    def _is_good(self, words: str) -> bool:
        try:
            self._check(words)
        except InputError as error:
            self._told += 1
            if self._told <= MAX_TOLD:
                more = "; further ones are not reported" if self._told == MAX_TOLD else ""
                print(f"livedrive: {error}{more}", file=sys.stderr)
            return False
        return True


def words_in(datagram: bytes) -> str | None:
    """The words of the last message to our address in a datagram; None where there is none."""
    found: str | None = None
    if len(datagram) > MAX_DATAGRAM:
        return None
    for message in osc.messages(datagram):
        values = osc.values(message) if osc.address(message) == ADDRESS else None
        if values is None:
            continue
        words = ":".join(f"{x:g}" if isinstance(x, float) else str(x) for x in values)
        if words.isprintable():  # what is printed shall not steer a terminal
            found = words
    return found
