"""Threads that share the work of a tick, the encoder's and the picture's: one a CPU, kept."""

import ctypes
import os
import sys
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from queue import SimpleQueue
from typing import Any, TypeVar

import numpy as np

from sensors.spinning import wait_for

MOST = 8
A = TypeVar("A")
B = TypeVar("B")
Work = Callable[[int], None]
Share = Callable[[Work, int], None]  # does work(0) .. work(parts - 1)
_LIBC = ctypes.CDLL(None) if sys.platform == "linux" else None


class Threads:
    """The caller and a helper for every other CPU, asleep until there is something to do."""

    def __init__(self) -> None:
        self.count = min(_cpus(), MOST)
        self._helpers: list[tuple[threading.Thread, SimpleQueue[Callable[[], None] | None]]] = []
        self._here = -1  # CPU of the caller when the helpers were last told
        wait_for(np.zeros(1, np.int64), 0)  # loads the loop now, and not in a tick

    def share(self, work: Work, parts: int) -> None:
        """Do work(0) .. work(parts - 1): whoever is free takes the next one.

        Nobody waits for a helper that is late, because its CPU is busy: the others do its parts.
        """
        left, done = iter(range(parts)), np.zeros(parts, np.int64)
        others = SimpleQueue[Exception | None]()  # what became of each part that helpers did

        def help_out() -> None:
            for part in left:
                try:
                    work(part)
                except Exception as error:
                    others.put(error)
                else:
                    others.put(None)
                done[part] = 1

        self._call(help_out)
        own = 0
        try:
            for part in left:
                own += 1
                work(part)
        finally:
            own += sum(1 for _ in left)  # after an error nobody does the rest
            wait_for(done, parts - own)
            failures = [others.get() for _ in range(parts - own)]
        for failure in failures:
            if failure:
                raise failure

    def both(self, here: Callable[[], A], there: Callable[[], B]) -> tuple[A, B]:
        """What two calls return that know nothing of each other: the first of the caller, the
        second of a helper; of the caller, too, where the helper's CPU is busy.
        """
        left, done = iter((there,)), np.zeros(1, np.int64)  # whoever takes it does it
        others = SimpleQueue[tuple[Any, Exception | None]]()

        def help_out() -> None:
            for work in left:
                try:
                    others.put((work(), None))
                except Exception as error:
                    others.put((None, error))
                done[0] = 1

        self._call(help_out, most=1)
        with self._staying():
            own = here()
            for work in left:
                return own, work()
            wait_for(done, 1)
            other, error = others.get()
        if error:
            raise error
        return own, other

    def close(self) -> None:
        """End the helpers; may be called twice."""
        for _, calls in self._helpers:
            calls.put(None)
        self._helpers = []

    def _call(self, work: Callable[[], None], most: int = MOST) -> None:
        while len(self._helpers) < self.count - 1:
            calls = SimpleQueue[Callable[[], None] | None]()
            thread = threading.Thread(target=_help, args=(calls,), name="helper", daemon=True)
            thread.start()
            self._helpers.append((thread, calls))
            self._here = -1
        self._step_aside()
        for _, calls in self._helpers[: min(self.count - 1, most)]:
            calls.put(work)

    def _step_aside(self) -> None:
        """Keep the helpers off the CPU of the caller: Linux likes to wake them there, picture
        after picture, and leaves the other CPUs idle."""
        if sys.platform != "linux":
            return
        here = _LIBC.sched_getcpu()
        if here == self._here:
            return
        self._here = here
        others = os.sched_getaffinity(0) - {here}
        for thread, _ in self._helpers if others else ():
            with suppress(OSError):  # we may not: pictures take longer
                os.sched_setaffinity(thread.native_id or 0, others)

    @contextmanager
    def _staying(self) -> Generator[None]:
        """The caller stays on its CPU: Linux likes to move it to the helper's, whenever it has
        waited for the interpreter, and leaves the other idle."""
        if sys.platform != "linux" or self._here < 0:
            yield
            return
        allowed = os.sched_getaffinity(0)
        with suppress(OSError):  # we may not: it takes longer
            os.sched_setaffinity(0, {self._here})
        try:
            yield
        finally:
            with suppress(OSError):
                os.sched_setaffinity(0, allowed)

    def __del__(self) -> None:
        self.close()


def in_turn(work: Work, parts: int) -> None:
    """The caller does all."""
    for part in range(parts):
        work(part)


def _help(calls: "SimpleQueue[Callable[[], None] | None]") -> None:
    for work in iter(calls.get, None):
        work()
        del work  # asleep it would keep whoever owns the work, and so these threads


def _cpus() -> int:
    """CPUs that this process may use."""
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1
