"""What a newcomer types first."""

import contextlib
import io
import re
import sys
from collections.abc import Iterator

import pytest
import tyro

from app.main import Command, main


@pytest.mark.parametrize(
    ("words", "said"), [([], "livedrive devices"), (["--version"], "livedrive 0.")]
)
def test_no_words_and_version(
    words: list[str],
    said: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(sys, "argv", ["livedrive", *words])
    main()
    assert said in capsys.readouterr().out


WITHOUT_OPTIONS = {("doctor",), ("avatar", "list"), ("session", "info")}


def subcommands(words: tuple[str, ...]) -> Iterator[tuple[str, ...]]:
    """Every command without subcommands, as its words."""
    shown = help_of(words)
    names = re.search(r"usage: livedrive[ \w]*? \[-h\] \{([\w,-]+)\}\n", shown)
    if names is None:
        yield words
    else:
        for name in names[1].split(","):
            yield from subcommands((*words, name))


def help_of(words: tuple[str, ...]) -> str:
    out = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.suppress(SystemExit):
        tyro.cli(Command, prog="livedrive", args=[*words, "-h"])
    return out.getvalue()


@pytest.mark.slow
def test_help_says_what_each_option_is_in_words(monkeypatch: pytest.MonkeyPatch) -> None:
    """Red before: `--out {None}|PATH`, `command.folder`, `(default: None)`, and no word at all."""
    monkeypatch.setenv("COLUMNS", "120")
    commands = list(subcommands(()))
    assert {("run",), ("call", "host"), ("eval", "prior"), ("session", "info")} <= set(commands)
    faults: list[str] = []
    for words in commands:
        shown = help_of(words).replace("\u2502", " ")
        odd = re.findall(r"None\b|%%|command\.[a-z]+ \(", shown)
        options = re.findall(r"^ +(--[a-z][\w-]+.*?)(?=\(default|^ +--|\Z)", shown, re.M | re.S)
        assert options or words in WITHOUT_OPTIONS
        silent = [
            option.strip() for option in options if not re.search(r"[\w)][.:;](\s|$)", option)
        ]
        faults += [f"{' '.join(words)}: {fault}" for fault in odd + silent]
    assert faults == []
