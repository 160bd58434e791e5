"""What a person wants of a running head; the loop reads it at the start of every tick."""

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from sensors.types import AudioPacket, Packet


@dataclass(frozen=True)
class Controls:
    """The present wishes. Counters mark requests: a request is new when its counter has grown."""

    avatar: str  # who is driven
    emotion: str | None = None  # words like "happy:0.7"; None: none picked here
    muted: bool = False  # the microphone is heard as silence, also by a recording
    recording: bool = False
    recentred: int = 0  # how often "this is straight ahead" was asked for
    resets: int = 0  # how often the head was told to start anew
    closed: bool = False  # the run shall end


class ControlPanel(Protocol):
    """Where wishes come from: the window, or a test."""

    def read(self) -> Controls:
        """The wishes of this moment; never blocks."""
        ...


def hushed(packet: Packet) -> Packet:
    """A packet of sound as silence; pictures pass."""
    if isinstance(packet, AudioPacket):
        return replace(packet, samples=np.zeros_like(packet.samples))
    return packet
