"""A kept thread that does one piece of work beside the caller's, on another CPU."""

from __future__ import annotations

import ctypes
import os
import sys
import threading
from collections.abc import Callable
from queue import SimpleQueue
from typing import TypeVar

T = TypeVar("T")
Call = Callable[[], None]
_LIBC = ctypes.CDLL(None) if sys.platform == "linux" else None


class Beside:
    """Sleeps until there is work; without a second CPU the caller does it itself."""

    def __init__(self) -> None:
        self._calls: SimpleQueue[Call | None] | None = None  # None: no thread
        self._thread: threading.Thread | None = None
        self._here = -1  # CPU of the caller when the thread was last kept off it

    def start(self, work: Callable[[], T]) -> Callable[[], T]:
        """Begin `work`; what is returned waits for its result, or raises what it raised."""
        if _cpus() < 2:
            return work
        if self._calls is None:
            self._calls = SimpleQueue[Call | None]()
            self._thread = threading.Thread(
                target=_serve, args=(self._calls,), name="beside", daemon=True
            )
            self._thread.start()
            self._here = -1
        self._step_aside()
        done = SimpleQueue[tuple[T | None, BaseException | None]]()

        def call() -> None:
            try:
                done.put((work(), None))
            except BaseException as error:
                done.put((None, error))

        def result() -> T:
            value, error = done.get()
            if error is not None:
                raise error
            return value  # type: ignore[return-value]  # no error: `work` has returned it

        self._calls.put(call)
        return result

    def close(self) -> None:
        """End the thread, after what it does; the next `start` begins another."""
        if self._calls is not None and self._thread is not None:
            self._calls.put(None)
            self._thread.join()
        self._calls = self._thread = None

    def _step_aside(self) -> None:
        """Keep the thread off the CPU of the caller, where Linux likes to wake it."""
        if _LIBC is None or self._thread is None:
            return
        here = _LIBC.sched_getcpu()
        if here == self._here:
            return
        self._here = here
        try:
            others = os.sched_getaffinity(0) - {here}
            os.sched_setaffinity(self._thread.native_id or 0, others)
        except OSError:  # we may not: it takes longer
            return

    def __del__(self) -> None:
        if self._calls is not None:
            self._calls.put(None)


def _serve(calls: SimpleQueue[Call | None]) -> None:
    for call in iter(calls.get, None):
        call()


def _cpus() -> int:
    """CPUs that this process may use."""
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1
