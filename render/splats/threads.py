"""Threads that share the work of a picture: one a CPU, kept from picture to picture."""

import ctypes
import os
import sys
import threading
from collections.abc import Callable

MOST = 8
Work = Callable[[], None]


class Threads:
    """The caller and a helper for every other CPU."""

    def __init__(self) -> None:
        self.count = min(_cpus(), MOST)
        self._helpers: list[_Helper] = []
        self._here = -1  # CPU of the caller when the helpers were last told

    def share(self, work: Callable[[int], None], parts: int) -> None:
        """Do work(0) .. work(parts - 1): whoever is free takes the next one."""
        left = iter(range(parts))

        def take() -> None:
            for part in left:
                work(part)

        while len(self._helpers) < self.count - 1:
            self._helpers.append(_Helper())
            self._here = -1
        self._step_aside()
        called = self._helpers[: self.count - 1]
        for helper in called:
            helper.call(take)
        try:
            take()
        finally:
            failures = [helper.finished() for helper in called]
        for failure in failures:
            if failure:
                raise failure

    def close(self) -> None:
        """End the helpers; may be called twice."""
        for helper in self._helpers:
            helper.call(None)
        self._helpers = []

    def _step_aside(self) -> None:
        """Keep the helpers off the CPU of the caller: Linux likes to wake them there, picture
        after picture, and leaves the other CPUs idle."""
        if sys.platform != "linux" or _LIBC is None:
            return
        here = _LIBC.sched_getcpu()
        if here == self._here:
            return
        self._here = here
        others = os.sched_getaffinity(0) - {here}
        for helper in self._helpers if others else ():
            try:
                os.sched_setaffinity(helper.thread.native_id or 0, others)
            except OSError:  # we may not: pictures take longer
                continue

    def __del__(self) -> None:
        self.close()


class _Helper:
    """A thread that sleeps until it is called."""

    def __init__(self) -> None:
        self._called, self._finished = threading.Lock(), threading.Lock()
        self._called.acquire()
        self._finished.acquire()
        self._work: Work | None = None
        self._failure: Exception | None = None
        self.thread = threading.Thread(target=self._run, name="splats", daemon=True)
        self.thread.start()

    def call(self, work: Work | None) -> None:
        """Do this once, or end."""
        self._work = work
        self._called.release()

    def finished(self) -> Exception | None:
        """Wait until the work is done; what went wrong."""
        self._finished.acquire()
        failure, self._failure = self._failure, None
        return failure

    def _run(self) -> None:
        while True:
            self._called.acquire()
            work, self._work = self._work, None
            if work is None:
                return
            try:
                work()
            except Exception as error:
                self._failure = error
            del work
            self._finished.release()


def _cpus() -> int:
    """CPUs that this process may use."""
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1


_LIBC = ctypes.CDLL(None) if sys.platform == "linux" else None
