"""The command line `livedrive`. Every command is a small class with `run`; see `livedrive -h`.

Errors end in one line and a status: 2 for bad input, 1 for a failure while running, 130 on Ctrl-C.
"""

import sys
from typing import Annotated

import tyro
from tyro.conf import subcommand

from app.avatar import Avatar
from app.bench import Bench
from app.calibrate import Calibrate
from app.capture import Capture
from app.devices import Devices
from app.doctor import Doctor
from app.eval import Eval
from app.record import Record
from app.replay import Replay
from app.run import Run
from app.session import Session
from app.train import Train

Command = (
    Annotated[Replay, subcommand("replay")]
    | Annotated[Run, subcommand("run")]
    | Annotated[Record, subcommand("record")]
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


def main() -> None:
    """Entry point of the console script."""
    from render.errors import InputError as RenderInputError
    from sensors.types import InputError

    command = tyro.cli(Command, prog="livedrive", config=(tyro.conf.FlagCreatePairsOff,))
    try:
        command.run()
    except (InputError, RenderInputError) as error:
        _fail(str(error), 2)
    except BrokenPipeError:
        sys.stderr.close()  # the reader of our output has seen enough
        raise SystemExit(1) from None
    except FileNotFoundError as error:
        _fail(f"expected a file or folder {error.filename}, got none; check the path", 2)
    except OSError as error:
        where = f" ({error.filename})" if error.filename else ""
        _fail(f"{error.strerror or error}{where}; what was written before it is kept", 1)
    except KeyboardInterrupt:
        _fail("stopped", 130)


def _fail(message: str, status: int) -> None:
    print("livedrive: " + " ".join(message.split()), file=sys.stderr)
    raise SystemExit(status)
