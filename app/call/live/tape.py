"""Recording in a call: runs only while it is on here and everybody agrees."""

from collections.abc import Callable
from pathlib import Path

from app.call.live.link import CallLink
from app.drive.controls import Controls
from app.drive.tape import PacketRecorder, Tape
from sensors.session.format import free_beside
from sensors.types import Packet

STEM = Path("call")


class CallTape:
    """Used in place of a Tape."""

    def __init__(
        self, link: CallLink, first: Path | None, record_to: Callable[[Path], PacketRecorder]
    ) -> None:
        self.wanted = first is not None
        self.sessions: list[Path] = []
        self.problem = ""
        self._link, self._record_to = link, record_to
        self._folder = first or STEM
        self._tape: Tape | None = None
        self._stopped: list[Tape] = []
        self._asked = False

    @property
    def failed(self) -> bool:
        return self._tape is not None and self._tape.failed

    def append(self, packet: Packet) -> None:
        self.follow()
        if self._tape is not None:
            self._tape.append(packet)

    def apply(self, wanted: Controls) -> None:
        self.wanted = wanted.recording
        self.follow()

    def follow(self) -> None:
        """Ask the others when recording is wanted; start and stop with their consent."""
        if self.wanted != self._asked:
            self._asked = self.wanted
            self._link.change(records=self.wanted)
        allowed = self.wanted and self._link.seats.may_record
        if allowed and self._tape is None:
            taken = self._folder.exists()
            folder = free_beside(self._folder) if taken else self._folder
            self._tape = Tape(folder, self._record_to)
        elif not allowed and self._tape is not None:
            self._stop()

    def close(self) -> None:
        """Finish every session."""
        self._stop()
        while self._stopped:
            tape = self._stopped.pop(0)
            tape.close()
            self.sessions += () if tape.problem else tape.sessions
            self.problem = tape.problem or self.problem

    def _stop(self) -> None:
        if self._tape is not None:
            self._tape.apply(Controls(avatar="", recording=False))  # no tick waits for its end
            self._stopped.append(self._tape)
            self._tape = None
