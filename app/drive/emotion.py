"""Which emotion the head shows: the words of the controls.

    words -> EmotionControl -> EmotionPacket among the packets -> recording, Assembler -> Driver

The words become a packet, so that a session keeps them and a replay shows them at the same frame.
"""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from sensors import folders
from sensors.types import EmotionPacket, Packet


class EmotionControl:
    """The words of the controls apply; without any, those of the source are shown."""

    def __init__(self) -> None:
        self._sent = self._recorded = ""

    def inject_emotion(self, packets: Iterable[Packet], words: str | None) -> Iterator[Packet]:
        """The packets with an EmotionPacket where the words change; None: as the source has it."""
        for packet in packets:
            if isinstance(packet, EmotionPacket):
                self._recorded = packet.words
                if words is None and packet.words != self._sent:
                    self._sent = packet.words
                    yield packet  # with its own time, so that a replay equals the run
                continue
            wanted = self._recorded if words is None else words
            if wanted != self._sent:
                self._sent = wanted
                yield EmotionPacket(packet.t_ns, wanted)
            yield packet


def said_with(labels: Sequence[str], words: str, clip: Path | None) -> str:
    """`words` in terms of the labels, with the CLIP model in `clip` or what it said before."""
    from encoder.emotion.text import clip_embed, understood

    cache = folders.config() / "emotion_words.json"
    return understood(words, labels, (lambda: clip_embed(clip)) if clip else None, cache)
