"""Recording a live run: what the driver gets, from the start or at the push of a button."""

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

from app.drive.controls import Controls
from sensors.session.format import free_beside
from sensors.types import EmotionPacket, Packet


class PacketRecorder(Protocol):
    """Where packets go; sensors.live.recorder.LiveRecorder is one."""

    problem: str  # reason why the recording has stopped

    def append(self, packet: Packet) -> None: ...
    def close(self) -> None: ...


class Tape:
    """Each time that recording is switched on makes a session; no tick waits for a disk."""

    def __init__(self, first: Path | None, record_to: Callable[[Path], PacketRecorder]) -> None:
        """With a `first` folder the tape is on from the start. Raises InputError where it holds
        something already. Later sessions lie beside it, or in session-001, -002, ..."""
        self._stem, self._record_to = first or Path("session"), record_to
        self._recorder: PacketRecorder | None = None
        self._closing: list[threading.Thread] = []
        self._emotion, self._begun = "", False  # what a session that starts now must know
        self.sessions: list[Path] = []
        self.problem = ""  # of the newest session that had one
        self.wanted = first is not None
        if first is not None:
            self._start(first)

    @property
    def failed(self) -> bool:
        """True while recording is on and its session cannot go on."""
        return self._recorder is not None and bool(self._recorder.problem)

    def append(self, packet: Packet) -> None:
        """Take a packet, or let it pass while the tape is off."""
        if isinstance(packet, EmotionPacket):
            self._emotion = packet.words
        if self._recorder is not None:
            if self._emotion and not self._begun and not isinstance(packet, EmotionPacket):
                self._recorder.append(EmotionPacket(packet.t_ns, self._emotion))
            self._begun = True
            self._recorder.append(packet)

    def apply(self, wanted: Controls) -> None:
        """Start or stop where `recording` has changed."""
        if wanted.recording == self.wanted:
            return
        self.wanted = wanted.recording
        if self.wanted:
            self._start(free_beside(self._stem))
        else:
            self._stop()

    def close(self) -> None:
        """Finish every session."""
        self._stop()
        for thread in self._closing:
            thread.join()

    def _start(self, folder: Path) -> None:
        self._recorder, self._begun = self._record_to(folder), False
        self.sessions.append(folder)

    def _stop(self) -> None:
        if self._recorder is not None:
            thread = threading.Thread(target=self._finish, args=[self._recorder], name="tape")
            thread.start()
            self._closing.append(thread)
            self._recorder = None

    def _finish(self, recorder: PacketRecorder) -> None:
        recorder.close()
        self.problem = recorder.problem or self.problem
