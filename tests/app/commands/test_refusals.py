"""What the user typed and no command can use: one line, without Python's words."""

import io
import sys
from pathlib import Path

import pytest

from app.command_line import run

WRONG = {
    "replay recordings/smoke --web 80x": (
        "--web: expected a whole number, got '80x'; see: livedrive replay -h"
    ),
    "replay recordings/smoke --size x": "--size: expected a whole number, got 'x'; see:",
    "replay recordings/smoke --size": "--size: expected a value after it, got none; see:",
    "replay recordings/smoke --sise 3": "got --sise 3; did you mean --size?; see:",
    "avatar list --x": "avatar list: expected an option that it has, got --x; see: livedrive",
    "replay x --vidoe y": "got --vidoe y; did you mean --video?; see: livedrive replay -h",
    "run --seconds soon": "--seconds: expected a number, got 'soon'; see: livedrive run -h",
    "session export a b --drop foo": "--drop: expected audio, eyes, got 'foo'; see:",
    "session --drop foo export a b": "session: expected an option that it has, got --drop foo;",
    "call host --port 99999": "--port: expected 0..65535, got 99999; see: livedrive call host -h",
    "eval photos --people 0": "--people: expected 1 or more, got 0; see: livedrive eval photos",
    "eval prior --expressions -1": "--expressions: expected 1 or more, got -1; see: livedrive eval",
    "eval speech d --samples 0": "--samples: expected 1 or more, got 0; see: livedrive eval speech",
    "eval emotion d --segments 0": "--segments: expected 1 or more, got 0; see: livedrive eval",
    "call foo": "call: expected host, join, server, bridge, test, got foo; see: livedrive call -h",
    "meet": "expected replay, run, record, ",
    "bench tick --minutes 1": "--minutes: expected one of the benches soak, web, got tick; leave",
    "avatar": "avatar: expected list, show, turn, create, export, got none; see: livedrive avatar",
    "replay": "replay: expected folder of the session, e.g. recordings/demo, got none; see:",
    "avatar show --bogus": "avatar show: expected name, got none; see: livedrive avatar show -h",
    "avatar show ben --bogus x": (
        "avatar show: expected --picture PATH, got --bogus x; see: livedrive avatar show -h"
    ),
}


@pytest.mark.parametrize("encoding", ["utf-8", "ascii"])
@pytest.mark.parametrize("words", WRONG)
def test_a_wrong_word_is_one_line(
    words: str,
    encoding: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Red before: a box of ten lines that spoke of NoneType."""
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(io.BytesIO(), encoding))
    with pytest.raises(SystemExit) as ended:
        run(words.split())
    told = capsys.readouterr().err
    assert ended.value.code == 2 and told.count("\n") == 1
    assert WRONG[words] in told
    assert "None" not in told and told.startswith("livedrive: ")


@pytest.mark.parametrize("kept", ['seconds = "soon"', 'bogus = "x"', 'headless = "yes"'])
def test_a_wrong_setting_names_its_file(
    kept: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Red before: not where the value is one too many."""
    file = tmp_path / "run.toml"
    file.write_text(kept)
    monkeypatch.setattr("app.terminal.profile.path", lambda: file)
    with pytest.raises(SystemExit):
        run(["run"])
    assert f"; mend {file}; see: livedrive run -h" in capsys.readouterr().err


def test_help_is_whole(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        run(["run", "-h"])
    assert not ended.value.code and "--seconds" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["replay", "recordings/smoke", "--pictures="], "--pictures: expected a value, got an"),
        (["replay", "recordings/smoke", "--pictures", ""], "word; leave --pictures away"),
        (["session", "create", "", "--audio", "x"], "livedrive: expected a value, got an empty"),
    ],
)
def test_an_empty_word_is_no_folder(
    words: list[str], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Red before: with = it was the current folder, and else a word before it was blamed."""
    with pytest.raises(SystemExit):
        run(words)
    assert told in capsys.readouterr().err
