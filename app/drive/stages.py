"""Timing of the named stages of a tick, without allocation in the loop."""

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
    """Wall and CPU time of each stage; `with stages("audio"): ...`.

    A tick is what one frame costs. Its time is the time between `begin` and `end`.
    """

    def __init__(self) -> None:
        self._wall_ns = {name: np.full(CAPACITY, 0, np.int64) for name in STAGES}
        self._cpu_ns = {name: np.full(CAPACITY, 0, np.int64) for name in STAGES}
        self._count = dict.fromkeys(STAGES, 0)

    @contextmanager
    def __call__(self, name: str) -> Generator[None]:
        wall, cpu = time.perf_counter_ns(), time.process_time_ns()
        try:
            yield
        finally:
            slot = self._count[name] % CAPACITY
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
        """{stage: {p50_ms, p95_ms, p99_ms, cpu_ms}}; cpu_ms is a mean over all threads."""
        out: dict[str, dict[str, float]] = {}
        for name in STAGES:
            count = min(self._count[name], CAPACITY)
            wall = self._wall_ns[name][:count] if count else np.zeros(1)
            p50, p95, p99 = np.percentile(wall, (50, 95, 99)) / 1e6
            cpu = self._cpu_ns[name][:count].mean() / 1e6 if count else 0.0
            out[name] = {"p50_ms": p50, "p95_ms": p95, "p99_ms": p99, "cpu_ms": float(cpu)}
            out[name] = {key: round(float(value), 3) for key, value in out[name].items()}
        return out
