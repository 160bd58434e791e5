"""Threads that share work: every part once, two calls at once, errors handed on, busy helpers."""

import os
import sys
import threading

import numpy as np
import pytest

from sensors.spinning import wait_for
from sensors.threads import Threads


def test_what_waits_is_compiled_before_there_is_work():
    threads = Threads()
    compiled = list(wait_for.signatures)
    threads.share(lambda part: None, 8)
    threads.both(lambda: None, lambda: None)
    assert len(compiled) == 1 and wait_for.signatures == compiled


def test_every_part_is_done_once_whoever_does_it():
    threads, done = Threads(), np.zeros(64, int)

    def work(part: int) -> None:
        done[part] += 1

    threads.share(work, 64)
    threads.share(work, 3)
    assert (done == 1 + (np.arange(64) < 3)).all()
    threads.close()
    threads.close()


def test_an_error_is_handed_on_and_nobody_is_left_at_work():
    threads, others = Threads(), set()

    def work(part: int) -> None:
        others.add(threading.current_thread())
        raise ValueError(part)

    for _ in range(3):
        with pytest.raises(ValueError, match=r"\d"):
            threads.share(work, 16)
    threads.close()
    for other in others - {threading.current_thread()}:
        other.join(5)
        assert not other.is_alive()


def test_nobody_waits_for_a_helper_that_is_late():
    threads, busy = Threads(), threading.Event()
    threads.count = 2
    threads._call(busy.wait)  # its CPU is busy
    done: list[int] = []
    threads.share(done.append, 5)
    assert done == [0, 1, 2, 3, 4]
    busy.set()
    threads.share(done.append, 5)
    assert sorted(done[5:]) == [0, 1, 2, 3, 4]
    threads.close()


def helped() -> Threads:
    """With one helper, on any machine."""
    threads = Threads()
    threads.count = 2
    return threads


def fail() -> None:
    raise ValueError("no eye")


def test_both_run_at_once_the_first_here() -> None:
    """Each waits for the other, so one after the other would not end."""
    threads, barrier = helped(), threading.Barrier(2, timeout=10)

    def meet() -> int:
        barrier.wait()
        return threading.get_ident()

    for _ in range(20):
        here, there = threads.both(meet, meet)
        assert here == threading.get_ident() != there
    threads.close()


def test_errors_of_both_surface_and_it_goes_on() -> None:
    threads = helped()
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
            threads.both(here, there)
    assert threads.both(lambda: 1, lambda: 2) == (1, 2)
    threads.close()


def test_both_are_done_here_where_the_helper_is_busy_or_there_is_none() -> None:
    threads, busy = helped(), threading.Event()
    threads._call(lambda: busy.wait(10) and None)
    own = threading.get_ident()
    assert threads.both(threading.get_ident, threading.get_ident) == (own, own)
    busy.set()
    threads.count = 1
    assert threads.both(threading.get_ident, threading.get_ident) == (own, own)
    threads.close()


def test_helpers_end_with_their_owner() -> None:
    threads = helped()
    threads.both(int, int)
    helper = threads._helpers[0][0]
    assert helper.is_alive()
    del threads  # never closed
    helper.join(10)
    assert not helper.is_alive()


class Owner:
    def __init__(self) -> None:
        self.threads, self.barrier = helped(), threading.Barrier(2, timeout=10)

    def work(self, part: int = 0) -> None:
        self.barrier.wait()


@pytest.mark.parametrize("way", ["share", "both"])
def test_helpers_end_with_the_owner_of_what_they_did(way: str) -> None:
    owner = Owner()
    if way == "share":
        owner.threads.share(owner.work, 2)
    else:
        owner.threads.both(owner.work, owner.work)
    helper = owner.threads._helpers[0][0]
    del owner
    helper.join(5)
    assert not helper.is_alive()


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere nobody is moved")
def test_the_caller_of_both_stays_on_a_cpu_until_it_returns() -> None:
    threads, allowed = helped(), os.sched_getaffinity(0)
    here, _ = threads.both(lambda: len(os.sched_getaffinity(0)), int)
    with pytest.raises(ValueError, match="no eye"):
        threads.both(fail, int)
    assert here == 1 and os.sched_getaffinity(0) == allowed
    threads.close()
