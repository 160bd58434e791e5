"""The command line `livedrive`. Every command is a small class with `run`; see `livedrive -h`.

Errors end in one line and a status: 2 for bad input, 1 for a failure while running, 130 on Ctrl-C.
"""

import shlex
import sys
from typing import Annotated

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
        command = tyro.cli(
            Command,
            prog="livedrive",
            args=_with_profile(words),
            config=(tyro.conf.FlagCreatePairsOff,),
        )
        command.run()
    except InputError as error:
        _fail(str(error), 2)
    except BrokenPipeError:
        sys.stderr.close()  # the reader of our output has seen enough
        raise SystemExit(1) from None
    except (FileNotFoundError, NotADirectoryError) as error:
        _fail(f"expected a file or folder {error.filename}, got none; check the path", 2)
    except FileExistsError as error:
        _fail(f"{error.filename}: expected a new name or a folder, got a file; choose another", 2)
    except OSError as error:
        where = f" ({error.filename})" if error.filename else ""
        _fail(f"{error.strerror or error}{where}; what was written before it is kept", 1)
    except KeyboardInterrupt:
        _fail("stopped", 130)


def _with_profile(words: list[str]) -> list[str]:
    """`run` begins with the options of the user's file; those of the command line come later."""
    from app.terminal import profile

    if words[0] != "run" or {"-h", "--help"} & set(words):
        return words
    kept = profile.words(profile.path())
    if kept:
        print(f"livedrive: with {profile.path()}: {shlex.join(kept)}", file=sys.stderr)
    return ["run", *kept, *words[1:]]


def _fail(message: str, status: int) -> None:
    from app.terminal.console import one_line

    print(f"livedrive: {one_line(message)}", file=sys.stderr)
    raise SystemExit(status)
