"""Outgoing packets of this end: Opus every 10 ms, codes every tick, on one count of
samples.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from app.call.media.opus import PACKET, OpusEncoder
from app.call.media.srtp import Stream
from app.call.wire.packet import TICKS, Ints, Packer, Tick
from sensors.types import NS, SAMPLE_RATE, SAMPLES_PER_FRAME

Sound = NDArray[np.float32]
MARKS = 3  # empty packets that announce silence
TOLERANCE = 48  # samples between voice and ticks before their offset is set anew
MAX_GAP = SAMPLE_RATE  # samples of lost sound that are sent as silence
# stream, content, media, and the counter it is sealed with (None: the next)
Send = Callable[[Stream, bytes, int, int | None], None]


class Outgoing:
    """Media counts samples from the first that was heard, lost ones too."""

    def __init__(self, packer: Packer, send: Send) -> None:
        self._packer, self._send, self._encoder = packer, send, OpusEncoder()
        self._sound = np.zeros(0, np.float32)  # not yet a whole packet
        self._at = 0  # media of its first sample
        self._first = 0  # the device's count at media 0
        self._time: tuple[int, int] | None = None  # media and our clock of the newest sound
        self._marks = 0
        self._ticks: list[Ints] = []  # newest first
        self._newest = -1
        self._offset: int | None = None

    @property
    def origin_ns(self) -> int | None:
        """Our clock at media 0, by the newest sound: a sound card's clock drifts."""
        return self._time and self._time[1] - self._time[0] * NS // SAMPLE_RATE

    def speak(self, first: int, samples: Sound, t_ns: int, muted: bool) -> None:
        """Sound of the microphone, by the device's count and the time of its first sample."""
        if self._time is None:
            self._time, self._first = (0, t_ns), first
        media, expected = first - self._first, self._at + len(self._sound)
        if not 0 <= media - expected <= MAX_GAP:  # the device restarted: use the clock
            passed = (t_ns - self._time[1]) * SAMPLE_RATE // NS
            media = max(expected, self._time[0] + passed)
            self._first = first - media
            if media - expected > MAX_GAP:
                self._at, self._sound = media, np.zeros(0, np.float32)
                self._at, samples = _next_packet(media, samples)
                expected = media
        if media > expected:
            samples = np.concatenate([np.zeros(media - expected, np.float32), samples])
        self._time = (media, t_ns)
        self._sound = np.concatenate([self._sound, samples])
        while len(self._sound) >= PACKET:
            packet, self._sound = self._sound[:PACKET], self._sound[PACKET:]
            self._say(self._at, packet, muted)
            self._at += PACKET

    def tick(self, tick: Tick, end_ns: int) -> None:
        """The own face at the end of the tick's sound. Raises MalformedError for NaN."""
        fields = self._packer.fields(tick)
        if tick.index != self._newest + 1:
            self._ticks.clear()
        self._ticks = [fields, *self._ticks][: min(TICKS, tick.index + 1)]
        self._newest = tick.index
        media, t_ns = self._time = self._time or (0, end_ns)
        end = media + round((end_ns - t_ns) * SAMPLE_RATE / NS)
        offset = end - (tick.index + 1) * SAMPLES_PER_FRAME
        if self._offset is None or abs(offset - self._offset) > TOLERANCE:
            self._offset = offset
        message = self._packer.message(self._ticks, tick.index, self._offset)
        self._send("codes", message, max(end, 0), None)

    def close(self) -> None:
        self._encoder.close()

    def _say(self, media: int, packet: Sound, muted: bool) -> None:
        number = media // PACKET
        if not muted:
            self._marks = 0
            self._send("voice", self._encoder.encode(packet), media, number)
        elif self._marks < MARKS:
            self._marks += 1
            self._send("voice", b"", media, number)


def _next_packet(media: int, samples: Sound) -> tuple[int, Sound]:
    """The first border of packets from `media` on, and the samples behind it."""
    border = -(-media // PACKET) * PACKET
    return border, samples[border - media :]
