"""What a trial's devices do in time: timers alone, as a sound card costs no turn of a task.

The CPU time of the person and the devices is counted apart from that of the call.
"""

import asyncio
import time
from collections.abc import Callable
from typing import ParamSpec, TypeVar

from sensors.types import NS, SAMPLE_RATE

STALL = SAMPLE_RATE // 10  # samples: a device that is later than this goes on without us
P = ParamSpec("P")
R = TypeVar("R")


class Beats:
    """Devices that begin together at `origin_ns` and end after `total` samples."""

    def __init__(self, origin_ns: int, total: int) -> None:
        self.origin_ns, self._total = origin_ns, total
        self.trial_s = 0.0  # CPU time
        self._call_s = 0.0

    def every(
        self, step: int, act: Callable[[int, int], None], missed: Callable[[int, int], None]
    ) -> asyncio.Future[None]:
        """`act` with each `step`th sample and how many ns late; `missed` with those left out: whole
        tenths of a second, in which the machine was busy elsewhere."""
        loop = asyncio.get_running_loop()
        ended: asyncio.Future[None] = loop.create_future()

        def beat(now: int) -> None:
            began_s, call_s = time.thread_time(), self._call_s
            late_ns = time.monotonic_ns() - self.at_ns(now)
            stalled = late_ns * SAMPLE_RATE // NS // STALL * STALL
            try:
                if stalled > 0:
                    missed(now, now + stalled)
                    now += stalled
                act(now, late_ns)
            except Exception as error:  # nobody awaits a timer
                ended.set_exception(error)
            self.trial_s += time.thread_time() - began_s - (self._call_s - call_s)
            if now + step < self._total and not ended.done():
                loop.call_at(self.at_ns(now + step) / NS, beat, now + step)
            elif not ended.done():
                ended.set_result(None)

        beat(0)
        return ended

    def at_ns(self, sample: int) -> int:
        return self.origin_ns + sample * NS // SAMPLE_RATE

    def of_call(self, part: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
        """What `part` of the call gives; its CPU time is not the trial's."""
        began_s = time.thread_time()
        try:
            return part(*args, **kwargs)
        finally:
            self._call_s += time.thread_time() - began_s
