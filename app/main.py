"""The start of `livedrive`: imports next to nothing, so that Ctrl-C is caught from here on.

The command line itself is app/command_line.py.
"""

import io
import os
import signal
import sys
import threading
from _thread import interrupt_main
from collections.abc import Generator
from contextlib import contextmanager
from types import FrameType
from typing import Any

LOCKS = ("llvmlite.binding.ffi", "numba.core.compiler_lock")
FIRST_STEPS = """\
livedrive replay recordings/demo --window    a recorded session as a talking head
livedrive devices                            what is here, and what to type
livedrive run                                live, from the microphone and the eye cameras

More: livedrive -h, livedrive run -h; something is missing: livedrive doctor"""


def main() -> None:
    """Entry point of the console script."""
    stdout: Any = sys.stdout
    if isinstance(stdout, io.TextIOWrapper):
        stdout.reconfigure(errors="replace")  # an ASCII terminal: tables lose their lines
    if sys.argv[1:] in ([], ["--version"]):
        from importlib.metadata import version

        _say(FIRST_STEPS if len(sys.argv) == 1 else f"livedrive {version('livedrive')}")
        return
    with _ctrl_c_ends_at_once():
        from app.command_line import run
    with _ends_as_on_ctrl_c():
        run(sys.argv[1:])


def _say(text: str) -> None:
    """Print it, or end with a line and status 1 where it does not fit."""
    try:
        print(text, flush=True)
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # for the rest, at the end
        print(f"livedrive: {error.strerror}", file=sys.stderr)
        raise SystemExit(1) from None


@contextmanager
def _ctrl_c_ends_at_once() -> Generator[None]:
    """For imports: libraries swallow a KeyboardInterrupt there, or make another error of it."""

    def end(*_: object) -> None:
        os.write(2, b"livedrive: stopped\n")
        os._exit(130)  # nothing has been opened or written yet

    before = signal.getsignal(signal.SIGINT)
    if before is not signal.default_int_handler:  # ignored, as of `nohup`: so it stays
        yield
        return
    signal.signal(signal.SIGINT, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def _ends_as_on_ctrl_c() -> Generator[None]:
    """For `kill` and a terminal that is closed: files are finished and drafts of them removed."""
    numbers = [getattr(signal, name, None) for name in ("SIGINT", "SIGTERM", "SIGHUP")]
    before = {number: signal.getsignal(number) for number in numbers if number}  # no HUP on Windows
    usual = (signal.SIG_DFL, signal.default_int_handler)
    ours = {number: handler for number, handler in before.items() if handler in usual}
    for number in ours:
        signal.signal(number, _interrupt)
    try:
        yield
    finally:
        for number, handler in ours.items():
            signal.signal(number, handler)


def _interrupt(number: int, frame: FrameType | None) -> None:
    """A moment later where numba takes a lock: it would keep it for ever, and helpers that load a
    loop would wait for it."""
    while frame:
        if frame.f_globals.get("__name__") in LOCKS:
            threading.Timer(0.01, interrupt_main, (number,)).start()
            return
        frame = frame.f_back
    raise KeyboardInterrupt
