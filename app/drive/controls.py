"""Controls of a running head; the loop reads them at the start of every tick."""

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from sensors.types import AudioPacket, Packet


@dataclass(frozen=True)
class Controls:
    """All of it at one moment. A request is new when its counter has grown."""

    avatar: str  # who is driven
    emotion: str | None = None  # words like "happy:0.7"; None: none picked here
    muted: bool = False  # sound is replaced by silence, also in a recording
    recording: bool = False
    recentred: int = 0  # how often "this is straight ahead" was asked for
    resets: int = 0  # how often the head was told to start anew
    closed: bool = False  # end the run


class ControlPanel(Protocol):
    """Where controls come from: the window, or a test."""

    def read(self) -> Controls:
        """The controls as they are now; never blocks."""
        ...


def muted(packet: Packet) -> Packet:
    """A packet of sound as silence; other packets pass unchanged."""
    if isinstance(packet, AudioPacket):
        return replace(packet, samples=np.zeros_like(packet.samples))
    return packet
