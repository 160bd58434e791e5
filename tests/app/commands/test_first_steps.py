"""What a newcomer types first."""

import contextlib
import io
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import tyro

from app.command_line import Command
from app.main import main

ROOT = Path(__file__).parents[3]


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


def test_a_failure_is_one_line_that_steers_no_terminal(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Red before: a folder that somebody sent could name itself an escape sequence."""
    monkeypatch.setattr(sys, "argv", ["livedrive", "session", "info", "a\x1b]0;mine\x07\nb"])
    with pytest.raises(SystemExit) as ended:
        main()
    told = capsys.readouterr().err
    assert ended.value.code == 2 and told.count("\n") == 1
    assert r"a\x1b]0;mine\x07 b" in told and "\x1b" not in told


@pytest.mark.skipif(sys.platform == "win32", reason="has no such device")
@pytest.mark.parametrize(
    "words", [[], ["--version"], ["-h"], ["avatar", "list"], ["avatar", "-h"]], ids=" ".join
)
def test_a_full_disk_takes_no_words(words: list[str]) -> None:
    """Red before: status 120, "Exception ignored in", as Python found it at its very end; and a
    traceback of --version."""
    code = "from app.main import main; main()"
    env = {k: v for k, v in os.environ.items() if k != "PYTHONUNBUFFERED"}
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-c", code, *words],
            env=env | {"PYTHONPATH": str(ROOT)},
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
        )
    assert done.returncode == 1
    assert done.stderr.startswith("livedrive: No space left") and done.stderr.count("\n") == 1


@pytest.mark.slow
def test_help_is_shown_on_a_terminal_that_knows_ascii_alone() -> None:
    """Red before: UnicodeEncodeError at the first dot of a list."""
    done = subprocess.run(
        [sys.executable, "-c", "from app.main import main; main()", "-h"],
        env=os.environ | {"PYTHONPATH": str(ROOT), "PYTHONIOENCODING": "ascii"},
        capture_output=True,
    )
    assert done.returncode == 0 and b"doctor" in done.stdout and done.stderr == b""


def test_paths_in_the_next_command_are_quoted() -> None:
    """Red before: a folder with a space in its name made three of them useless."""
    lines = [line for file in (ROOT / "app").rglob("*.py") for line in file.open(encoding="utf-8")]
    filled = [words for line in lines for words in re.findall(r"next: (livedrive.*)\"", line)]
    assert len(filled) > 4
    ends = [words for words in filled if re.search(r" \{(?!quote\(|demo\})", words)]
    assert ends == []


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
        if words == ("record",):  # which has no page
            odd += re.findall(r"--mic [^\n]*web", shown)
        silent = [
            option.strip() for option in options if not re.search(r"[\w)][.:;](\s|$)", option)
        ]
        faults += [f"{' '.join(words)}: {fault}" for fault in odd + silent]
    assert faults == []


def test_the_command_line_starts_without_networks_and_compilers() -> None:
    """Red before: every help text took 3 s, and Ctrl-C in them showed a traceback; so did
    `avatar list`, what cannot be opened, and the process of a call."""
    heavy = {"numba", "scipy", "torch", "onnxruntime"}
    light = "app.command_line, app.compose.live_run, app.compose.replay, app.web.link"
    light += ", app.call.live.service, render.decoder.coding, render.decoder.learned.avatar_files"
    code = f"import sys, {light}; print(*({heavy} & set(sys.modules)))"
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stdout.strip()) == (0, ""), done.stderr
