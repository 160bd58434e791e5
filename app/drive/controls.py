"""Controls of a running head; the loop reads them at the start of every tick."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Protocol

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


SHARED = ("avatar", "emotion", "muted")  # fields that people at a page may change, too


class ControlPanel(Protocol):
    """Where controls come from: the window, or a test."""

    def read(self) -> Controls:
        """The controls as they are now; never blocks."""
        ...


class WithPage:
    """A panel with what people at the page picked laid over it; what was changed last holds."""

    def __init__(
        self,
        panel: ControlPanel | None,  # None: there is the page alone
        picks: Callable[[], dict[str, Any]],  # fields of Controls, new since the last call
        avatar: str,
        tell: Callable[[dict[str, Any]], None] = lambda _: None,  # what was changed at the panel
    ) -> None:
        self._panel, self._picks, self._tell = panel, picks, tell
        self._before = Controls(avatar=avatar)
        self._picked: dict[str, Any] = {}
        self._started = False

    def read(self) -> Controls:
        wanted = self._panel.read() if self._panel else self._before
        new = {k: getattr(wanted, k) for k in SHARED} if self._started else {}
        changed = {k: v for k, v in new.items() if v != getattr(self._before, k)}
        self._before, self._started = wanted, True
        picks = self._picks()
        self._picked = {k: v for k, v in self._picked.items() if k not in changed} | picks
        if told := {k: v for k, v in changed.items() if k not in picks}:
            self._tell(told)
        return replace(wanted, **self._picked)


def muted(packet: Packet) -> Packet:
    """A packet of sound as silence; other packets pass unchanged."""
    if isinstance(packet, AudioPacket):
        return replace(packet, samples=np.zeros_like(packet.samples))
    return packet
