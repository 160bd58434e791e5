"""Controls of a running head; the loop reads them at the start of every tick."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from sensors.types import AudioPacket, Packet, Request, RequestPacket


@dataclass(frozen=True)
class Controls:
    """All of it at one moment. A request is new when its counter has grown."""

    avatar: str  # who is driven
    emotion: str | None = None  # words like "happy:0.7"; None: as the source has it
    muted: bool = False  # sound is replaced by silence, also in a recording
    recording: bool = False
    recentred: int = 0  # how often "this is straight ahead" was asked for
    resets: int = 0  # how often the head was told to start anew
    closed: bool = False  # end the run


SHARED = ("avatar", "emotion", "muted")  # fields that can be changed at several places


class ControlPanel(Protocol):
    """Where controls come from: a Panel, or a test."""

    def read(self) -> Controls:
        """The controls as they are now; never blocks."""
        ...


class ControlPlace(Protocol):
    """Where people or programs change the controls, and see how they stand: window, page, ..."""

    def picks(self) -> dict[str, Any]:
        """Fields of Controls that were changed here since the last call; never blocks."""
        ...

    def show(self, changed: dict[str, Any]) -> None:
        """What was changed elsewhere, of those in SHARED."""
        ...


class Panel:
    """One state of the controls for all places; what was changed last holds, and all show it."""

    def __init__(self, controls: Controls, places: Sequence[ControlPlace] = ()) -> None:
        self._controls, self._places = controls, places

    def read(self) -> Controls:
        for place in self._places:
            picks = place.picks()
            self._controls = replace(self._controls, **picks)
            if shared := {k: v for k, v in picks.items() if k in SHARED}:
                for other in self._places:
                    if other is not place:
                        other.show(shared)
        return self._controls


class RequestControl:
    """What the controls ask for once becomes a packet, so that a replay does it at the same frame.

    controls -> RequestPacket among the packets -> recording, Assembler -> Driver
    """

    def __init__(self) -> None:
        self._done: dict[Request, int] = {"reset": 0, "recentre": 0}

    def inject_requests(self, packets: Iterable[Packet], controls: Controls) -> Iterator[Packet]:
        """The packets, with what is new before the first of them."""
        asked: dict[Request, int] = {"reset": controls.resets, "recentre": controls.recentred}
        for packet in packets:
            for wanted, times in asked.items():
                if times > self._done[wanted]:
                    yield RequestPacket(packet.t_ns, wanted)
            self._done = asked
            yield packet


def muted(packet: Packet) -> Packet:
    """A packet of sound as silence; other packets pass unchanged."""
    if isinstance(packet, AudioPacket):
        return replace(packet, samples=np.zeros_like(packet.samples))
    return packet
