"""Which emotion the head shows: the words of the command line, the window and the network.

    words -> EmotionControl -> EmotionPacket among the packets -> recording, Assembler -> Driver

The words become a packet, so that a session keeps them and a replay shows them at the same frame.
"""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from app.drive.emotion_port import OscPort
from sensors import folders
from sensors.types import EmotionPacket, Packet


class EmotionControl:
    """The newest words apply, whatever their origin; without any, those of the source are shown."""

    def __init__(self, start: str | None = None, port: OscPort | None = None) -> None:
        self.start = start  # None: as recorded
        self._wanted, self._port = start, port
        self._picked: str | None = None  # as the window last had it
        self._started = False  # the window's first choice is no change
        self._sent = self._recorded = ""

    def inject_emotion(self, packets: Iterable[Packet], picked: str | None) -> Iterator[Packet]:
        """The packets with an EmotionPacket where the words change; `picked`: the window's."""
        if self._started and picked != self._picked:
            self._wanted = picked
        self._picked, self._started = picked, True
        if self._port and (words := self._port.read()) is not None:
            self._wanted = words
        for packet in packets:
            if isinstance(packet, EmotionPacket):
                self._recorded = packet.words
                if self._wanted is None and packet.words != self._sent:
                    self._sent = packet.words
                    yield packet  # with its own time, so that a replay equals the run
                continue
            wanted = self._recorded if self._wanted is None else self._wanted
            if wanted != self._sent:
                self._sent = wanted
                yield EmotionPacket(packet.t_ns, wanted)
            yield packet

    def close(self) -> None:
        if self._port:
            self._port.close()


def said_with(labels: Sequence[str], words: str, clip: Path | None) -> str:
    """`words` in terms of the labels, with the CLIP model in `clip` or what it said before."""
    from encoder.emotion.text import clip_embed, understood

    cache = folders.config() / "emotion_words.json"
    return understood(words, labels, (lambda: clip_embed(clip)) if clip else None, cache)
