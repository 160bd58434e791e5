"""Clocks: deadlines are absolute, manual time moves only when told to."""

import pytest

from sensors.clock import ManualClock, MonotonicClock


def test_manual_clock() -> None:
    clock = ManualClock(5)
    clock.sleep_until_ns(20)
    clock.sleep_until_ns(10)
    assert clock.now_ns() == 20
    clock.advance_ns(3)
    assert clock.now_ns() == 23
    with pytest.raises(ValueError, match="cannot go back"):
        clock.advance_ns(-1)


def test_monotonic_clock_reaches_its_deadline() -> None:
    clock = MonotonicClock()
    deadline = clock.now_ns() + 2_000_000
    clock.sleep_until_ns(deadline)
    assert clock.now_ns() >= deadline
