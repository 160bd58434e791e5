"""ClockMap on made-up arrivals: exact in spite of delays, drift told, losses told from stalls."""

import numpy as np
import pytest

from sensors.clock_map import JUMP_NS, ClockMap
from sensors.types import NS

OFFSET = 123_456_789_012
BLOCK = NS // 100


def delays(num: int, seed: int = 0) -> list[int]:
    """0 to 4 ms, now and then 15 ms."""
    rng = np.random.default_rng(seed)
    late = rng.uniform(0, 4e6, num) + 15e6 * (rng.random(num) < 0.02)
    return [int(d) for d in late]


def feed(
    clock: ClockMap, first: int, late: list[int], rate: float = 1.0, lost: int = 0
) -> list[int]:
    """Errors of the told times, in ns. `rate`: device time per our time."""
    errors: list[int] = []
    for k, delay in enumerate(late, first):
        device_ns = round(k * BLOCK * rate) - lost
        true_ns = OFFSET + k * BLOCK
        errors.append(clock.update(device_ns, true_ns + delay) - true_ns)
    return errors


def test_times_are_exact_although_every_arrival_is_late() -> None:
    errors = feed(ClockMap(), 0, delays(2000))
    assert max(abs(e) for e in errors[200:]) < 200_000
    assert min(errors) >= 0


@pytest.mark.parametrize("ppm", [-100, 60])
def test_drift_is_measured_and_followed(ppm: int) -> None:
    clock = ClockMap()
    errors = feed(clock, 0, delays(12_000), rate=1 + ppm * 1e-6)
    assert clock.drift_ppm == pytest.approx(ppm, abs=8)
    assert max(abs(e) for e in errors[6000:]) < 500_000


def test_lost_device_time_is_a_jump_of_that_size() -> None:
    clock, jumps = ClockMap(), []
    feed(clock, 0, delays(500))
    lost = 470_000_000
    for k in range(500, 800):
        feed(clock, k, delays(1, k), lost=lost)
        jumps.append(clock.jump_ns)
    assert sum(j != 0 for j in jumps) == 1
    assert sum(jumps) == pytest.approx(lost, abs=5_000_000)
    errors = feed(clock, 800, delays(100), lost=lost)
    assert max(abs(e) for e in errors) < 2_000_000


def test_a_stall_that_loses_nothing_is_no_jump() -> None:
    clock = ClockMap()
    feed(clock, 0, delays(500))
    burst = [(100 - k) * BLOCK for k in range(100)]  # one second comes at once
    for k, delay in enumerate(burst, 500):
        feed(clock, k, [delay])
        assert clock.jump_ns == 0
    for k in range(600, 900):
        feed(clock, k, delays(1, k))
        assert clock.jump_ns == 0


def test_a_device_clock_that_was_set_ahead_is_followed_at_once() -> None:
    clock = ClockMap()
    feed(clock, 0, delays(300))
    errors = feed(clock, 300, [0, 0], lost=-5 * NS)
    assert errors == [0, 0]
    feed(clock, 302, [JUMP_NS // 2], lost=-5 * NS)
    assert clock.jump_ns == 0


def test_a_device_may_count_from_anywhere() -> None:
    """Red before: a page's counter, or a camera's microseconds, ended the run or the camera after
    twenty seconds."""
    told = []
    for start_ns in (0, 10**21):
        clock = ClockMap()
        told.append([clock.update(start_ns + k * NS // 4, k * NS // 4 + k % 7) for k in range(200)])
        assert abs(clock.drift_ppm) < 1
    assert max(abs(a - b) for a, b in zip(*told, strict=True)) < 1000
