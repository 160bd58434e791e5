"""`livedrive session` as a user meets it: how far it is, and what to type next."""

import io
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest
import soundfile

from app.commands.session import CreateSession, ExportSession
from sensors.types import InputError

SMOKE = Path(__file__).parents[3] / "recordings" / "smoke"


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.slow
def test_making_and_exporting_tell_how_far_they_are_and_what_comes_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Red before: nothing for 49 s, and a next line that a folder with a space broke."""
    folder = tmp_path / "my own session"
    soundfile.write(tmp_path / "a.wav", np.zeros(48_000, np.float32), 48_000)
    monkeypatch.setattr("sys.stderr", shown := Terminal())
    CreateSession(folder=folder, audio=tmp_path / "a.wav").run()
    ExportSession(folder=folder, out=tmp_path / "out.mkv").run()
    assert "writing: 1 s of sound" in shown.getvalue()
    assert "exporting: 1 s of sound" in shown.getvalue()
    told = capsys.readouterr().out
    (line,) = [line for line in told.splitlines() if line.startswith("next: ")]
    assert shlex.split(line)[1:4] == ["livedrive", "replay", str(folder)]
    shutil.rmtree(folder)


def test_an_export_says_which_pictures_are_missing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(SMOKE, tmp_path / "s")
    eye = tmp_path / "s" / "eye_left.mkv"
    eye.write_bytes(eye.read_bytes()[:60_000])
    ExportSession(folder=tmp_path / "s", out=tmp_path / "out.mkv").run()
    assert "eye pictures are missing; restore the eye videos" in capsys.readouterr().out


def test_a_session_of_nothing_is_told_what_to_type(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="try --audio x.wav"):
        CreateSession(folder=tmp_path / "s").run()
