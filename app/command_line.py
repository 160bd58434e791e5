"""The command line `livedrive`. Every command is a small class with `run`; see `livedrive -h`.

Errors end in one line and a status: 2 for bad input, 1 for a failure while running, 130 on Ctrl-C.
"""

import contextlib
import io
import os
import shlex
import sys
from typing import Annotated, Any, TextIO, get_args

import tyro
from tyro.conf import subcommand

from app.commands.avatar import Avatar
from app.commands.bench import Bench
from app.commands.calibrate import Calibrate
from app.commands.capture import Capture
from app.commands.devices import Devices
from app.commands.doctor import Doctor
from app.commands.eval import Eval
from app.commands.meet.call import Call
from app.commands.record import Record
from app.commands.replay import Replay
from app.commands.run import Run
from app.commands.session import Session
from app.commands.train import Train
from sensors.types import InputError

Command = (
    Annotated[Replay, subcommand("replay")]
    | Annotated[Run, subcommand("run")]
    | Annotated[Record, subcommand("record")]
    | Annotated[Call, subcommand("call")]
    | Annotated[Calibrate, subcommand("calibrate")]
    | Annotated[Session, subcommand("session")]
    | Annotated[Avatar, subcommand("avatar")]
    | Annotated[Capture, subcommand("capture")]
    | Annotated[Train, subcommand("train")]
    | Annotated[Eval, subcommand("eval")]
    | Annotated[Bench, subcommand("bench")]
    | Annotated[Devices, subcommand("devices")]
    | Annotated[Doctor, subcommand("doctor")]
)


def run(words: list[str]) -> None:
    """Run the command that the words name."""
    try:
        try:
            command = _parsed(words)
            command.run()
        finally:
            _flush()
    except InputError as error:
        _fail(str(error), 2)
    except BrokenPipeError:
        sys.stderr.close()  # the reader of our output has seen enough
        raise SystemExit(1) from None
    except (FileNotFoundError, NotADirectoryError) as error:
        _fail(f"expected a file or folder {error.filename}, got none; check the path", 2)
    except IsADirectoryError as error:
        _fail(f"{error.filename}: expected a file, got a folder; give a file in it", 2)
    except FileExistsError as error:
        _fail(f"{error.filename}: expected a new name or a folder, got a file; choose another", 2)
    except OSError as error:
        where = f" ({error.filename})" if error.filename else ""
        kept = next(iter(getattr(error, "__notes__", ())), "what was written before it is kept")
        _fail(f"{error.strerror or error}{where}; {kept}", 1)
    except KeyboardInterrupt:
        _fail("stopped", 130)


def _flush() -> None:
    """What was printed leaves here, where a failure is told, and not at the end of Python."""
    stdout: TextIO | None = sys.stdout  # none where the shell closed it
    if stdout is None:
        return
    try:
        stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), stdout.fileno())  # for the rest, at the end
        raise


def _parsed(words: list[str]) -> Command:
    """The command, or InputError. `run` begins with the options of the user's file; those of the
    command line come later."""
    from app.terminal import profile, refusals

    refusals.check_empty(words)
    kept = list[str]()
    if words[0] == "run" and not {"-h", "--help"} & set(words):
        kept = profile.words(profile.path(), words)
    if kept:
        print(f"livedrive: with {profile.path()}: {shlex.join(kept)}", file=sys.stderr)
    command, refusal = _tried([words[0], *kept, *words[1:]])
    if command is not None:
        return command
    theirs = kept and _tried(words)[0] is not None
    where = f"mend {profile.path()}; " if theirs else ""
    names = _names(Command, words)
    said = refusals.one_line(refusal, " ".join(names))
    raise InputError(f"{said}; {where}see: {shlex.join(['livedrive', *names, '-h'])}")


def _tried(words: list[str]) -> tuple[Command | None, str]:
    """The command, or what the parser says against it."""
    told = io.StringIO()
    try:
        with contextlib.redirect_stderr(told):
            config = (tyro.conf.FlagCreatePairsOff,)
            return tyro.cli(Command, prog="livedrive", args=words, config=config), ""
    except SystemExit as end:
        if end.code != 2:
            raise
        return None, told.getvalue()


def _names(commands: Any, words: list[str]) -> list[str]:
    """The first words, as far as they name a command, e.g. avatar show."""
    for command, conf in map(get_args, get_args(commands)):
        if words[:1] == [conf.name]:
            parts = get_args(command.__annotations__.get("command"))
            return [conf.name, *(_names(parts[0], words[1:]) if parts else [])]
    return []


def _fail(message: str, status: int) -> None:
    from app.terminal.console import one_line

    print(f"livedrive: {one_line(message)}", file=sys.stderr)
    raise SystemExit(status)
