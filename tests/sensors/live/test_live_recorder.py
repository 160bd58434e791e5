"""LiveRecorder: all packets on disk; a disk that fails costs one line and no driving."""

import resource
import stat
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from material import packets, same_packet

from sensors.live.recorder import LiveRecorder
from sensors.session import wav
from sensors.session.export import export
from sensors.session.recording import Recording, RecordingWriter
from sensors.types import EmotionPacket, InputError, Packet


def recorder(folder: Path, told: list[str]) -> LiveRecorder:
    return LiveRecorder(folder, created="", devices={"audio": "mic"}, tell=told.append)


def test_what_is_appended_is_recorded(tmp_path: Path) -> None:
    sent, told = packets(0.4), list[str]()
    tape = recorder(tmp_path / "s", told)
    for packet in sent:
        tape.append(packet)
    tape.close()
    tape.close()
    assert told == []
    with Recording(tmp_path / "s") as recording:
        assert recording.card["closed"] is True
        got = [recording.packet(entry) for entry in recording.entries]
    assert all(b is not None and same_packet(a, b) for a, b in zip(sent, got, strict=True))


def test_sound_that_no_longer_fits_goes_on_in_another_session(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Red before: the recording ended after 6.2 hours."""
    monkeypatch.setattr(wav, "MAX_DATA_BYTES", 4 * 48_000 // 5)  # a fifth of a second
    (tmp_path / "s-001").mkdir()
    (tmp_path / "s-001" / "somebody's").write_text("")
    sent, told = [EmotionPacket(0, "happy"), *packets(0.5)], list[str]()
    tape = recorder(tmp_path / "s", told)
    for packet in sent:
        tape.append(packet)
    tape.close()
    assert [line.split()[-1] for line in told] == [str(tmp_path / f"s-{k:03d}") for k in (2, 3)]
    got: list[Packet | None] = []
    for name in ("s", "s-002", "s-003"):
        with Recording(tmp_path / name) as recording:
            first, *rest = [recording.packet(entry) for entry in recording.entries]
            assert isinstance(first, EmotionPacket) and first.words == "happy"
            got += rest
    assert all(b is not None and same_packet(a, b) for a, b in zip(sent[1:], got, strict=True))


@pytest.mark.parametrize("waiting", [1, 2000])
def test_a_disk_that_hangs_holds_up_no_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, waiting: int
) -> None:
    """Red before: with a full queue `close` never returned, and else nothing was told."""
    began, goes_on = threading.Event(), threading.Event()

    def hang(self: RecordingWriter, packet: Packet) -> None:
        began.set()
        goes_on.wait()

    monkeypatch.setattr(RecordingWriter, "append", hang)
    monkeypatch.setattr("sensors.live.recorder.JOIN_S", 0.05)
    told = list[str]()
    tape = recorder(tmp_path / "s", told)
    tape.append(EmotionPacket(0, "happy"))
    assert began.wait(30)
    for _ in range(waiting):
        tape.append(EmotionPacket(0, "happy"))
    closing = threading.Thread(target=tape.close, daemon=True)
    closing.start()
    closing.join(5)
    assert not closing.is_alive() and len(told) == 1
    assert ("too slow" if waiting > 1 else "does not answer") in told[0]
    goes_on.set()


def test_a_session_that_cannot_be_finished_holds_up_no_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Red before: the end waited half a minute for more packets."""

    def fail(self: RecordingWriter, **_: bool) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(RecordingWriter, "close", fail)
    told = list[str]()
    tape = recorder(tmp_path / "s", told)
    closing = threading.Thread(target=tape.close, daemon=True)
    closing.start()
    closing.join(5)
    assert not closing.is_alive() and len(told) == 1 and "No space left" in told[0]


def test_recordings_belong_to_their_owner_alone(tmp_path: Path) -> None:
    folder = tmp_path / "s"
    tape = recorder(folder, [])
    for packet in packets(0.1):
        tape.append(packet)
    tape.close()
    export(folder, tmp_path / "out.mkv")
    for path in [*folder.iterdir(), tmp_path / "out.mkv"]:
        assert stat.S_IMODE(path.stat().st_mode) == 0o600, path
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700


def test_a_folder_that_cannot_be_written_costs_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    told: list[str] = []
    tape = recorder(tmp_path / "file" / "s", told)
    for packet in packets(0.1):
        tape.append(packet)
    tape.close()
    assert len(told) == 1
    assert "driving goes on" in told[0]
    LiveRecorder(
        tmp_path / "file" / "s", created="", devices={}, tell=told.append, alone=True
    ).close()
    assert "driving" not in told[1]  # `livedrive record` drives nothing
    assert tape.problem


def test_a_used_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="new or empty"):
        recorder(tmp_path, [])


FULL_DISK = """
import resource, signal, sys
from pathlib import Path
from material import packets
from sensors.live.recorder import LiveRecorder
resource.setrlimit(resource.RLIMIT_FSIZE, (1_000_000, 1_000_000))
told = []
tape = LiveRecorder(Path(sys.argv[1]), created="", devices={}, tell=told.append)
for packet in packets(2.0):
    tape.append(packet)
tape.close()
assert len(told) == 1, told
assert tape.problem
print("drove on")
"""


def test_a_full_disk_stops_the_recording_and_keeps_what_was_written(tmp_path: Path) -> None:
    """A limit on file sizes makes real writes fail in the middle, for libsndfile's and FFmpeg's."""
    here = Path(__file__)
    path = f"{here.parents[1]}:{here.parents[3]}"
    done = subprocess.run(
        [sys.executable, "-c", FULL_DISK, str(tmp_path / "s")],
        env={"PYTHONPATH": path, "PATH": "/usr/bin:/bin"},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.stdout == "drove on\n", done.stderr
    with Recording(tmp_path / "s") as recording:
        assert recording.card["repaired"]
        assert len(recording.entries) > 5
        assert all(recording.packet(entry) is not None for entry in recording.entries)
    assert resource.getrlimit(resource.RLIMIT_FSIZE)[0] != 1_000_000


def test_a_folder_that_cannot_be_made_keeps_nothing(tmp_path: Path) -> None:
    """Red before: "expected to go on recording ...; what was recorded is kept"."""
    (tmp_path / "file").touch()
    told: list[str] = []
    folder = tmp_path / "file" / "s"
    recorder = LiveRecorder(folder, created="", devices={}, tell=told.append, alone=True)
    assert recorder.problem
    assert told == [f"{folder}: expected to begin recording, got: Not a directory; choose another"]
