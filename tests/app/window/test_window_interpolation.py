"""Motion between ticks: even at every display's rate, one tick late, and what it does when late."""

import numpy as np
import pytest

from app.window.state.interpolation import PERIOD_NS, Interpolation
from sensors.types import NS


def gaze(yaw: float) -> np.ndarray:
    return np.tile(np.array([np.sin(yaw), 0.0, np.cos(yaw)], np.float32), (2, 1))


def ramp(motion: Interpolation, hz: int, jitter_ns: int) -> np.ndarray:
    """What a display of `hz` shows of a code that grows by 1 with each tick."""
    rng, shown = np.random.default_rng(0), []
    posts = [(k * PERIOD_NS, k * PERIOD_NS + int(rng.integers(jitter_ns + 1))) for k in range(120)]
    for now in range(0, 119 * PERIOD_NS, NS // hz):
        while posts and posts[0][1] <= now:
            t_ns, posted_ns = posts.pop(0)
            code = np.full(256, t_ns / PERIOD_NS, np.float32)
            motion.push(t_ns, posted_ns, code, gaze(0.1))
        drawn = motion.at(now)
        shown.append(np.nan if drawn is None else drawn[0][0])
    return np.array(shown)


@pytest.mark.parametrize("hz", [60, 72, 144])
def test_steps_are_even_on_any_display(hz: int) -> None:
    steps = np.diff(ramp(Interpolation(), hz, jitter_ns=0)[hz:])
    np.testing.assert_allclose(steps, 30 / hz, rtol=0.02)
    newest = np.diff(ramp(Interpolation(smooth=False), hz, jitter_ns=0)[hz:])
    assert set(np.round(newest)) == {0.0, 1.0}  # without smoothing it goes in whole ticks


def test_late_ticks_disturb_little() -> None:
    steps = np.diff(ramp(Interpolation(), 72, jitter_ns=6_000_000)[72:])
    assert (steps >= 0).all() and steps.max() < 0.8  # 0.42 is even, 1 a whole tick


def test_it_lags_by_one_tick() -> None:
    motion, delay_ns = Interpolation(), 40_000_000
    for k in range(40):
        motion.push(k * PERIOD_NS, k * PERIOD_NS + delay_ns, np.full(256, k, np.float32), gaze(0))
    just_posted = 39 * PERIOD_NS + delay_ns
    drawn = motion.at(just_posted)
    assert drawn is not None and drawn[0][0] == pytest.approx(38.0)
    motion.smooth = False
    drawn = motion.at(just_posted)
    assert drawn is not None and drawn[0][0] == 39.0


def test_a_turn_told_with_the_other_sign_is_the_same_turn() -> None:
    """Red before: a window crashed where a tracker changed the sign, as behind one's back."""
    motion, head = Interpolation(), np.array([0, 0, 0, 0.1, 0, 0.995, 0, 0.5], np.float32)
    for k in range(3):
        sign = np.array([1, 1, 1, *[(-1) ** k] * 4, 1], np.float32)
        motion.push(k * PERIOD_NS, k * PERIOD_NS, np.zeros(256, np.float32), gaze(0), head * sign)
    for share in (0.25, 0.5, 1.25, 1.5, 5):
        drawn = motion.at(round((1 + share) * PERIOD_NS))
        assert drawn is not None
        np.testing.assert_allclose(np.abs(drawn[2]), head, atol=1e-6)


def test_a_missing_tick_holds_the_newest_and_none_is_none() -> None:
    motion = Interpolation()
    assert motion.at(0) is None
    motion.push(0, 0, np.zeros(256, np.float32), gaze(0.0))
    motion.push(PERIOD_NS, PERIOD_NS, np.ones(256, np.float32), gaze(0.6))
    late = motion.at(100 * PERIOD_NS)
    assert late is not None and late[0][0] == 1.0
    middle = motion.at(PERIOD_NS + PERIOD_NS // 2)
    assert middle is not None
    np.testing.assert_allclose(np.linalg.norm(middle[1], axis=1), 1.0, rtol=1e-6)
    np.testing.assert_allclose(middle[1], gaze(0.3), atol=0.01)


def test_a_run_that_starts_anew_is_followed() -> None:
    motion = Interpolation()
    for t in (50, 51, 0, 1):
        motion.push(t * PERIOD_NS, 10**12 + t, np.full(256, t, np.float32), gaze(0))
    drawn = motion.at(10**12 + NS)
    assert drawn is not None and drawn[0][0] == 1.0
