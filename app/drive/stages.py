"""Timing of the named stages of a tick."""

import time
from collections.abc import Generator
from contextlib import contextmanager

import numpy as np

STAGES = (
    *("assemble", "audio", "eyes", "gaze", "denoise", "decode", "draw", "readback", "sinks"),
    "tick",
)
CAPACITY = 30 * 60 * 10  # the last ten minutes of ticks


class Stages:
    """Wall and CPU time of each stage; `with stages("audio"): ...`. "tick" is around all others."""

    def __init__(self) -> None:
        self._wall_ns = {name: np.full(CAPACITY, 0, np.int64) for name in STAGES}
        self._cpu_ns = {name: np.full(CAPACITY, 0, np.int64) for name in STAGES}
        self._own_ns = {name: np.full(CAPACITY, 0, np.int64) for name in STAGES}
        self._count = dict.fromkeys(STAGES, 0)

    @contextmanager
    def __call__(self, name: str) -> Generator[None]:
        wall, cpu = time.perf_counter_ns(), time.process_time_ns()
        own = time.thread_time_ns()
        try:
            yield
        finally:
            slot = self._count[name] % CAPACITY
            self._own_ns[name][slot] = time.thread_time_ns() - own
            self._wall_ns[name][slot] = time.perf_counter_ns() - wall
            self._cpu_ns[name][slot] = time.process_time_ns() - cpu
            self._count[name] += 1

    def latest_ms(self) -> list[float]:
        """What each stage last took, in the order of STAGES; 0 for one that never ran."""
        return [self._wall_ns[name][self._count[name] % CAPACITY - 1] / 1e6 for name in STAGES]

    def undo(self, *names: str) -> None:
        """Forget the last entry of these stages."""
        for name in names:
            self._count[name] -= 1

    def summary(self) -> dict[str, dict[str, float]]:
        """{stage: {p50_ms, p95_ms, p99_ms, cpu_ms, own_ms}}: times on the clock, and means of the
        CPU's: of all threads, also of those that do something else meanwhile (a replay decodes the
        next pictures), and of the loop's own thread."""
        out: dict[str, dict[str, float]] = {}
        for name in STAGES:
            count = max(min(self._count[name], CAPACITY), 1)  # one that never ran: zeros
            p50, p95, p99 = np.percentile(self._wall_ns[name][:count], (50, 95, 99))
            cpu, own = (spent[name][:count].mean() for spent in (self._cpu_ns, self._own_ns))
            names = ("p50_ms", "p95_ms", "p99_ms", "cpu_ms", "own_ms")
            times = zip(names, (p50, p95, p99, cpu, own), strict=True)
            out[name] = {key: round(float(value) / 1e6, 3) for key, value in times}
        return out
