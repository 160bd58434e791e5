"""Waiting awake: until others have set their flags, and not for ever."""

import threading
import time

import numpy as np

from sensors.spinning import wait_for


def test_it_ends_when_others_have_set_as_many_flags() -> None:
    """A hundred rounds: were flags not seen as they are set, each would take all its looks."""
    flags, go = np.zeros(3, np.int64), threading.Barrier(2)

    def helper() -> None:
        for _ in range(100):
            go.wait(10)
            flags[2] = 1

    thread = threading.Thread(target=helper)
    thread.start()
    seen = 0
    for _ in range(100):
        flags[:] = 0
        go.wait(10)
        wait_for(flags, 1)
        seen += int(flags[2])
        while not flags[2]:
            time.sleep(0)
    thread.join(10)
    assert seen > 50  # the machine may have other work now and then


def test_it_gives_up_where_nobody_sets_them() -> None:
    flags = np.zeros(1, np.int64)
    start = time.perf_counter()
    wait_for(flags, 1)
    assert time.perf_counter() - start < 1.0
    flags[0] = 1
    wait_for(flags, 1)
    wait_for(flags, 0)
