"""The record button: one session a push, nothing waits, failure takes the button back."""

import threading
from pathlib import Path

import numpy as np

from app.drive.controls import Controls
from app.drive.tape import Tape
from sensors.types import AudioPacket

PACKET = AudioPacket(0, 0, np.zeros(4, np.float32))
ON, OFF = Controls("ben", recording=True), Controls("ben", recording=False)


class Made:
    """A recorder that remembers; closing waits for `gate`."""

    gate = threading.Event()

    def __init__(self, folder: Path) -> None:
        folder.mkdir()
        self.problem, self.packets, self.closed = "", 0, False

    def append(self, packet: AudioPacket) -> None:
        self.packets += 1

    def close(self) -> None:
        assert Made.gate.wait(20)
        self.closed = True


def test_each_push_makes_a_session_and_stopping_never_waits(tmp_path: Path) -> None:
    made: list[Made] = []
    Made.gate.clear()
    tape = Tape(tmp_path / "mine", lambda folder: made.append(Made(folder)) or made[-1])
    tape.append(PACKET)
    tape.apply(ON)  # no change
    tape.apply(OFF)  # returns although the recorder cannot close yet
    tape.append(PACKET)
    tape.apply(ON)
    tape.append(PACKET)
    tape.append(PACKET)
    assert [session.name for session in tape.sessions] == ["mine", "mine-001"]
    assert [recorder.packets for recorder in made] == [1, 2]
    Made.gate.set()
    tape.close()
    assert all(recorder.closed for recorder in made) and tape.problem == ""


def test_off_until_the_button_and_never_into_what_exists(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "session-001").mkdir()
    Made.gate.set()
    tape = Tape(None, Made)
    tape.append(PACKET)
    assert not tape.wanted and tape.sessions == []
    tape.apply(ON)
    assert tape.sessions == [Path("session-002")]
    tape.close()


def test_a_problem_is_kept_and_shown(tmp_path: Path) -> None:
    made: list[Made] = []
    Made.gate.set()
    tape = Tape(tmp_path / "a", lambda folder: made.append(Made(folder)) or made[-1])
    assert not tape.failed
    made[0].problem = "No space left on device"
    assert tape.failed
    tape.apply(OFF)
    assert not tape.failed
    tape.close()
    assert tape.problem == "No space left on device"
