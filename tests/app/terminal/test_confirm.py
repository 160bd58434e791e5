"""Nothing is written over before somebody who can be asked has said so."""

import io
from pathlib import Path

import pytest

from app.commands.session import ExportSession
from app.commands.train import Train
from app.terminal import confirm
from sensors.types import InputError

SMOKE = Path(__file__).parents[3] / "recordings" / "smoke"


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def answered(monkeypatch: pytest.MonkeyPatch, answer: str) -> Terminal:
    """Somebody sits at the terminal and types this."""
    asked = Terminal()
    monkeypatch.setattr("sys.stdin", Terminal(answer))
    monkeypatch.setattr("sys.stderr", asked)
    return asked


def test_it_asks_and_takes_no_for_an_answer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    old, folder, empty = tmp_path / "out.mkv", tmp_path / "heads", tmp_path / "empty"
    old.write_text("mine")
    folder.mkdir()
    empty.mkdir()
    (folder / "frame_000000.ply").write_text("")
    for answer in ("\n", "n\n", ""):
        asked = answered(monkeypatch, answer)
        with pytest.raises(InputError, match="which is kept"):
            confirm.overwriting([old, None, folder, empty, tmp_path / "new"])
        assert f"{old}, {folder}: there already" in asked.getvalue()
    answered(monkeypatch, "y\n")
    confirm.overwriting([old, folder])
    asked = answered(monkeypatch, "")
    confirm.overwriting([empty, tmp_path / "new", None])
    assert asked.getvalue() == ""


def test_training_asks_before_the_state_of_a_stopped_run_is_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Red before: without --resume a day of training was gone within a minute."""
    (tmp_path / "audio_state.safetensors").write_text("a day")
    answered(monkeypatch, "n\n")
    with pytest.raises(InputError, match=r"audio_state\.safetensors, which is kept; add --resume"):
        Train(stage="audio", data=tmp_path, out=tmp_path).run()
    answered(monkeypatch, "")
    with pytest.raises(InputError, match="--resume: expected the state of a run"):  # not asked
        Train(stage="audio", data=tmp_path, out=tmp_path, resume=True).run()


@pytest.mark.slow
def test_an_export_asks_and_a_script_is_not_asked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Red before: written over without a word."""
    out = tmp_path / "out.mkv"
    out.write_text("mine")
    with monkeypatch.context() as patched:
        answered(patched, "n\n")
        with pytest.raises(InputError):
            ExportSession(folder=SMOKE, out=out).run()
    assert out.read_text() == "mine"
    monkeypatch.setattr("sys.stdin", io.StringIO(""))
    ExportSession(folder=SMOKE, out=out).run()
    assert out.stat().st_size > 1000
