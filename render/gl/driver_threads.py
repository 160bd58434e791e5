"""The threads of a software GL driver, spread over the CPUs.

Each pass wakes all of them at once; Linux then likes to leave two on the CPU of the caller while
another CPU idles, pass after pass, which doubles the time of a picture for minutes.
"""

import os
import sys
from pathlib import Path

TASKS = Path("/proc/self/task")


def running() -> set[int]:
    """Threads of this process; none where the system does not tell."""
    return {int(task.name) for task in TASKS.iterdir()} if TASKS.exists() else set()


def spread(threads: set[int]) -> None:
    """Let one half of the threads use one half of the CPUs, the others the other."""
    if sys.platform != "linux" or not threads:
        return
    cpus = sorted(os.sched_getaffinity(0))
    halves = cpus[::2], cpus[1::2]
    if not halves[1]:
        return
    for index, thread in enumerate(sorted(threads)):
        try:
            os.sched_setaffinity(thread, halves[index % 2])
        except OSError:  # it has ended, or we may not: the picture takes longer
            continue
