"""Which emotion the head shows: the words of the command line, the window and the network.

    wish -> EmotionControl -> EmotionPacket among the packets -> recording, Assembler -> Driver

The wish becomes a packet, so that a session keeps it and a replay shows it at the same frame.
"""

import contextlib
import os
import socket
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from sensors.types import EmotionPacket, InputError, Packet

ADDRESS = "/livedrive/emotion"
MAX_DATAGRAM = 2048
MAX_A_TICK = 16  # messages read in one tick; the rest wait


class EmotionControl:
    """The newest wish wins, wherever it comes from; without one, the source's own words count."""

    def __init__(self, start: str | None = None, port: "OscPort | None" = None) -> None:
        self._wish, self._port = start, port
        self._picked: str | None = None  # as the window last had it
        self._seen = False  # the window
        self._sent = self._recorded = ""

    def led(self, packets: Iterable[Packet], picked: str | None) -> Iterator[Packet]:
        """The packets with the wish among them; `picked`: what the window shows as chosen."""
        if self._seen and picked != self._picked:
            self._wish = picked
        self._picked, self._seen = picked, True
        if self._port and (words := self._port.read()) is not None:
            self._wish = words
        for packet in packets:
            if isinstance(packet, EmotionPacket):
                self._recorded = packet.words
                if self._wish is None and packet.words != self._sent:
                    self._sent = packet.words
                    yield packet  # with its own time, so that a replay equals the run
                continue
            wanted = self._recorded if self._wish is None else self._wish
            if wanted != self._sent:
                self._sent = wanted
                yield EmotionPacket(packet.t_ns, wanted)
            yield packet

    def close(self) -> None:
        if self._port:
            self._port.close()


class OscPort:
    """Listens for OSC messages `/livedrive/emotion happy:0.7`, or `happy 0.7`; never waits."""

    def __init__(self, host: str, port: int, check: Callable[[str], None]) -> None:
        """`check` raises InputError at words that cannot be shown; they are told and left."""
        self._check = check
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.bind((host, port))
        except (OSError, OverflowError) as error:
            self._socket.close()
            raise InputError(
                f"--listen: expected a free UDP port, got {host}:{port} ({error}); try another"
            ) from None

    @property
    def port(self) -> int:
        return int(self._socket.getsockname()[1])

    def read(self) -> str | None:
        """The newest good words since the last call, or None."""
        newest: str | None = None
        with contextlib.suppress(BlockingIOError):
            for _ in range(MAX_A_TICK):
                words = _words(self._socket.recv(MAX_DATAGRAM))
                if words is not None and self._is_good(words):
                    newest = words
        return newest

    def close(self) -> None:
        self._socket.close()

    def _is_good(self, words: str) -> bool:
        try:
            self._check(words)
        except InputError as error:
            print(f"livedrive: {error}", file=sys.stderr)
            return False
        return True


def said_with(labels: Sequence[str], words: str, clip: Path | None) -> str:
    """`words` in terms of the labels, with the CLIP model in `clip` or what it said before."""
    from encoder.emotion_text import clip_embed, understood

    home = os.environ.get("XDG_CONFIG_HOME")
    cache = (Path(home) if home else Path.home() / ".config") / "livedrive" / "emotion_words.json"
    return understood(words, labels, (lambda: clip_embed(clip)) if clip else None, cache)


def _words(datagram: bytes) -> str | None:
    """The words of the last message to our address in a datagram."""
    from pythonosc import osc_bundle, osc_message, osc_packet

    found: str | None = None
    try:
        messages: Any = osc_packet.OscPacket(datagram).messages
    except (osc_packet.ParseError, osc_bundle.ParseError, osc_message.ParseError):
        return None
    for timed in messages:
        message: Any = timed.message
        if message.address == ADDRESS:
            found = ":".join(f"{x:g}" if isinstance(x, float) else str(x) for x in message.params)
    return found
