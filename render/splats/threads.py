"""Threads that share the work of a picture: one a CPU, kept from picture to picture."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

MOST = 8


class Threads:
    """The caller and as many others as there are more CPUs. They end with what holds them."""

    def __init__(self) -> None:
        self.count = min(_cpus(), MOST)
        self._others = ThreadPoolExecutor(max(self.count - 1, 1), "splats")

    def share(self, work: Callable[[int], None], parts: int) -> None:
        """Do work(0) .. work(parts - 1): whoever is free takes the next one."""
        left = iter(range(parts))

        def take() -> None:
            for part in left:
                work(part)

        others = [self._others.submit(take) for _ in range(self.count - 1)]
        try:
            take()
        finally:
            for other in others:
                other.result()

    def close(self) -> None:
        """May be called twice."""
        self._others.shutdown()


def _cpus() -> int:
    """CPUs that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
