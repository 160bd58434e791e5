"""The user's TOML file: options before those of the command line."""

import sys
from pathlib import Path

import pytest

from app.commands.run import Run
from app.main import main
from app.terminal import profile
from sensors.types import InputError


@pytest.fixture
def ran(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Run]:
    """What `run` was asked to do, instead of doing it."""
    made: list[Run] = []
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    monkeypatch.setattr(Run, "run", lambda self: made.append(self))
    (tmp_path / "livedrive").mkdir()
    return made


def run(monkeypatch: pytest.MonkeyPatch, *words: str) -> None:
    monkeypatch.setattr(sys, "argv", ["livedrive", "run", *words])
    main()


def test_the_command_line_wins(
    ran: list[Run], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run(monkeypatch)
    assert ran[0].mic is None and capsys.readouterr().err == ""
    profile.path().write_text(
        'mic = "none"\neyes = ["uvc:0", "uvc:1"]\nheadless = true\nwindow = false\nsize = 256\n'
        'virtual_camera = "auto"\n'
    )
    run(monkeypatch, "--eyes", "uvc:2", "--seed", "3")
    asked = ran[1]
    assert asked.mic == "none" and asked.headless and asked.size == 256 and asked.seed == 3
    assert asked.eyes == ("uvc:2",) and asked.virtual_camera == "auto"
    assert str(profile.path()) in capsys.readouterr().err


@pytest.mark.parametrize(
    "text", ["mic = ", "mic = [[1]]", "eyes = []", "[mic]\na = 1", "mic = 2026-01-01", "\xff"]
)
def test_a_file_that_is_wrong_is_one_line(
    ran: list[Run], monkeypatch: pytest.MonkeyPatch, text: str
) -> None:
    profile.path().write_bytes(text.encode("latin-1"))
    with pytest.raises(InputError, match=r"run\.toml: expected"):
        profile.words(profile.path())
    with pytest.raises(SystemExit) as ended:
        run(monkeypatch)
    assert ended.value.code == 2 and not ran


def test_an_unknown_option_is_told(
    ran: list[Run], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    profile.path().write_text('microphone = "x"\n')
    with pytest.raises(SystemExit):
        run(monkeypatch)
    told = capsys.readouterr().err
    assert str(profile.path()) in told and "--microphone" in told and not ran


def test_what_cannot_be_both_follows_the_command_line(
    ran: list[Run], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Red before: `run --window` was refused for a `headless = true` in the file."""
    profile.path().write_text("headless = true\n")
    run(monkeypatch, "--window")
    assert ran[0].window and not ran[0].headless


def test_a_home_folder_is_found_as_a_shell_finds_it(
    ran: list[Run], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Red before: a folder named ~ was made. Some editors begin a file with a mark."""
    profile.path().write_text('\ufeffweights = "~/w"\n', encoding="utf-8")
    run(monkeypatch)
    assert ran[0].weights == Path.home() / "w"


def test_the_file_is_not_blamed_for_the_command_line(
    ran: list[Run], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    profile.path().write_text("size = 256\n")
    for words in (("--sizee", "300"), ("--size",)):
        with pytest.raises(SystemExit):
            run(monkeypatch, *words)
        assert "mend" not in capsys.readouterr().err
    assert not ran
