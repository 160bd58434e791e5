"""Clocks: the only place where the sensors learn what time it is.

Flow: live code gets a MonotonicClock, tests and fast replay get a ManualClock; that is
the whole difference.
"""

import time

from sensors.types import NS


class MonotonicClock:
    """The operating system's monotonic time; absolute deadlines keep pacing from drifting."""

    def now_ns(self) -> int:
        return time.monotonic_ns()

    def sleep_until_ns(self, t_ns: int) -> None:
        while (left_ns := t_ns - time.monotonic_ns()) > 0:
            time.sleep(left_ns / NS)


class ManualClock:
    """Time that moves only when told to, so that pacing can be tested exactly."""

    def __init__(self, start_ns: int = 0) -> None:
        self._now_ns = start_ns

    def now_ns(self) -> int:
        return self._now_ns

    def sleep_until_ns(self, t_ns: int) -> None:
        self._now_ns = max(self._now_ns, t_ns)

    def advance_ns(self, step_ns: int) -> None:
        if step_ns < 0:
            raise ValueError(f"time cannot go back: step_ns is {step_ns}")
        self._now_ns += step_ns
