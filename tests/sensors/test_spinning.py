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


def test_it_gives_up_where_nobody_sets_them_and_does_not_wait_for_what_is_set() -> None:
    def shortest_s(flags: np.ndarray, count: int) -> float:
        times = list[float]()
        for _ in range(20):
            start = time.perf_counter()
            wait_for(flags, count)
            times.append(time.perf_counter() - start)
        return min(times)

    one_set = np.array([0, 0, 1], np.int64)
    in_vain = shortest_s(one_set, 2)
    assert in_vain < 0.1
    assert max(shortest_s(one_set, 1), shortest_s(0 * one_set, 0)) < in_vain / 5
