"""Where Ctrl-C and `kill` have to wait: in what is done wholly or not at all."""

import signal
from collections.abc import Callable, Generator
from contextlib import contextmanager
from threading import current_thread, main_thread
from typing import Any


@contextmanager
def postponed() -> Generator[None]:
    """What a signal's handler would raise in here is raised at the end of the block."""
    handlers: dict[int, Callable[..., Any]] = {}
    came: list[int] = []

    def wait(number: int, _: object) -> None:
        came.append(number)

    try:
        if current_thread() is main_thread():  # no other is ever interrupted
            for name in ("SIGINT", "SIGTERM", "SIGHUP"):  # the last is none of Windows
                number = getattr(signal, name, None)
                handler = signal.getsignal(number) if number else None
                if number and callable(handler):
                    handlers[number] = handler
                    signal.signal(number, wait)
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
    if came:
        handlers[came[0]](came[0], None)
