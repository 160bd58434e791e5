"""Two pieces of work at once: one here, one on a thread that is kept for it, on another CPU."""

from __future__ import annotations

import ctypes
import os
import sys
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from queue import SimpleQueue
from typing import Any, TypeAlias, TypeVar

Here = TypeVar("Here")
There = TypeVar("There")
Calls: TypeAlias = SimpleQueue[Callable[[], None] | None]
_LIBC = ctypes.CDLL(None) if sys.platform == "linux" else None


class Beside:
    """The thread sleeps between calls; without a second CPU there is none."""

    def __init__(self) -> None:
        self._thread: threading.Thread | None = None
        self._calls = Calls()
        self._away_from = -1  # CPU that the thread is kept off

    def both(self, here: Callable[[], Here], there: Callable[[], There]) -> tuple[Here, There]:
        """Results of both; raises what either raised. Nobody waits for a thread that has not begun,
        because its CPU is busy: the caller does its work then.
        """
        if cpus() < 2:
            return here(), there()
        left = iter((there,))  # whoever takes it does it
        done = SimpleQueue[Any]()

        def call() -> None:
            for work in left:
                try:
                    done.put((work(), None))
                except BaseException as error:
                    done.put((None, error))

        with self._apart():
            self._calls.put(call)
            own = here()
            for work in left:
                return own, work()
            other, error = done.get()
        if error is not None:
            raise error
        return own, other

    def close(self) -> None:
        """End the thread; the next call begins another."""
        if self._thread is not None:
            self._calls.put(None)
            self._thread.join()
        self._thread = None

    def __del__(self) -> None:
        self._calls.put(None)

    @contextmanager
    def _apart(self) -> Generator[None]:
        """The caller and the thread each stay on a CPU: Linux likes to wake one where the other
        runs, whenever it has waited for the interpreter, and leaves the other CPU idle."""
        if self._thread is None:
            self._thread = threading.Thread(
                target=_serve, args=(self._calls,), name="beside", daemon=True
            )
            self._thread.start()
            self._away_from = -1
        if sys.platform != "linux" or _LIBC is None:
            yield
            return
        allowed, cpu = os.sched_getaffinity(0), _LIBC.sched_getcpu()
        with suppress(OSError):  # we may not: it takes longer
            if cpu != self._away_from:
                os.sched_setaffinity(self._thread.native_id or 0, allowed - {cpu})
                self._away_from = cpu
            os.sched_setaffinity(0, {cpu})
        try:
            yield
        finally:
            with suppress(OSError):
                os.sched_setaffinity(0, allowed)


def _serve(calls: Calls) -> None:
    for call in iter(calls.get, None):
        call()


def cpus() -> int:
    """CPUs that this thread may use."""
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1
