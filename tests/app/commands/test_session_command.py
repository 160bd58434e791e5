"""`livedrive session` as a user meets it: how far it is, and what to type next."""

import io
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest
import soundfile

from app.commands.session import CreateSession, ExportSession


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
