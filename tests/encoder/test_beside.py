"""Two pieces of work at once: results, failures, a busy CPU, no second CPU, and the end."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest

from encoder import beside
from encoder.beside import Beside
from encoder.nn import philox


@pytest.fixture
def pair(monkeypatch: pytest.MonkeyPatch) -> Iterator[Beside]:
    monkeypatch.setattr(beside, "cpus", lambda: 2)
    made = Beside()
    yield made
    made.close()


def threads() -> int:
    return sum(thread.name == "beside" for thread in threading.enumerate())


def fail() -> None:
    raise ValueError("no eye")


def test_both_run_at_once(pair: Beside) -> None:
    """Each waits for the other, so one after the other would not end."""
    barrier = threading.Barrier(2, timeout=10)

    def meet() -> int:
        barrier.wait()
        return threading.get_ident()

    for _ in range(20):
        here, there = pair.both(meet, meet)
        assert here == threading.get_ident() != there
    assert threads() == 1


def test_errors_surface_and_it_goes_on(pair: Beside) -> None:
    for own_fails, other_fails in ((False, True), (True, False), (True, True)):
        begun = threading.Event()

        def there(begun: threading.Event = begun, fails: bool = other_fails) -> None:
            begun.set()
            if fails:
                fail()

        def here(begun: threading.Event = begun, fails: bool = own_fails) -> None:
            assert begun.wait(10)
            if fails:
                fail()

        with pytest.raises(ValueError, match="no eye"):
            pair.both(here, there)
    assert pair.both(lambda: 1, lambda: 2) == (1, 2)


def test_nobody_waits_for_a_thread_that_has_not_begun(pair: Beside) -> None:
    free, begun = threading.Event(), threading.Event()

    def busy() -> None:
        begun.set()
        free.wait(10)

    pair.both(int, int)  # the thread exists
    pair._calls.put(busy)
    assert begun.wait(10)
    here, there = pair.both(threading.get_ident, threading.get_ident)
    free.set()
    assert here == there == threading.get_ident()


def test_without_a_second_cpu_there_is_no_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(beside, "cpus", lambda: 1)
    before, alone = threads(), Beside()
    assert alone.both(lambda: 1, lambda: 2) == (1, 2) and threads() == before


def test_the_thread_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(beside, "cpus", lambda: 2)
    before, one = threads(), Beside()
    for _ in range(2):  # closed, it begins anew
        one.both(int, int)
        assert threads() == before + 1
        one.close()
        assert threads() == before
    one.both(int, int)
    del one  # never closed
    deadline = time.monotonic() + 10
    while threads() > before and time.monotonic() < deadline:
        time.sleep(0.01)
    assert threads() == before


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere nobody is moved")
def test_the_caller_stays_where_it_may_run(pair: Beside) -> None:
    allowed = os.sched_getaffinity(0)
    here, _ = pair.both(lambda: len(os.sched_getaffinity(0)), int)
    with pytest.raises(ValueError, match="no eye"):
        pair.both(fail, int)
    assert here == 1 and os.sched_getaffinity(0) == allowed


@pytest.mark.parametrize("seed", [0, 5, 2**63 + 7, 2**100 + 3])
def test_a_kept_generator_is_a_new_one(seed: int) -> None:
    for place in ((0, 0, 0, 0), (30, 0, 5, 12345), (1, 0, 2, 2**40)):
        for draw in ("standard_normal", "random"):
            new = np.random.Generator(np.random.Philox(key=seed, counter=list(place)))
            kept = philox.generator(seed, *place)
            kept.integers(10, size=3, dtype=np.int32)  # leaves half a number behind
            kept = philox.generator(seed, *place)
            expected = getattr(new, draw)(7, dtype=np.float32)
            assert np.array_equal(getattr(kept, draw)(7, dtype=np.float32), expected)
