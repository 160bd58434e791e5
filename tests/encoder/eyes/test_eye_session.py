"""What a session learns by itself of lids and gaze, how fast, and that it never jumps."""

from __future__ import annotations

import numpy as np
import pytest

from encoder.eyes.format import unit
from encoder.eyes.session import BRIEF, USUAL, SessionState, learned, new_session
from sensors.types import FPS

BOTH = np.ones(2, bool)
AHEAD = unit(USUAL)


def lived(
    lids: np.ndarray, gaze: np.ndarray, state: SessionState | None = None
) -> tuple[SessionState, list[np.ndarray]]:
    """lids [T], one gaze [2, 3] -> the state after, and the lids that were shown."""
    state, shown = state or new_session(), []
    for lid in lids:
        both = np.full(2, lid, np.float32)
        shown.append(state.calibration().apply(gaze, gaze, both)[1])
        state = learned(both, gaze, BOTH, state)
    return state, shown


def blinking(wide: float, shut: float, seconds: int) -> np.ndarray:
    """A blink of 5 frames every 2 s."""
    frames = np.arange(seconds * FPS) % (2 * FPS)
    return np.where(frames >= 2 * FPS - 5, shut, wide)


def test_usual_eyes_stay_as_they_are() -> None:
    state, shown = lived(blinking(0.95, 0.0, 60), AHEAD)
    assert np.abs(np.array(shown)[:, 0] - blinking(0.95, 0.0, 60)).max() < 0.06
    assert np.abs(state.calibration().apply(AHEAD, AHEAD, BOTH)[0] - AHEAD).max() < 1e-3


def test_narrow_eyes_open_within_a_minute_and_shut_ones_shut() -> None:
    _, shown = lived(blinking(0.6, 0.15, 60), AHEAD)
    last = np.array(shown)[-2 * FPS :, 0]
    assert last.max() > 0.75 and last.min() < 0.05
    steps = np.abs(np.diff(np.array(shown)[:, 0][blinking(0.6, 0.15, 60) > 0.5]))
    assert steps.max() < 0.03  # it never jumps


@pytest.mark.parametrize("seconds, left", [(3, 0.85), (60, 0.4)])
def test_the_usual_gaze_becomes_straight_ahead(seconds: int, left: float) -> None:
    off = np.float32([[0.15, -0.2], [0.1, 0.05]])  # each eye by its own
    gaze = unit(USUAL + off)
    state, _ = lived(np.ones(seconds * FPS), gaze)
    after = state.calibration().apply(gaze, gaze, BOTH)[0]
    rest = np.abs(after[:, :2] - USUAL) / np.abs(off)
    assert rest.max() < left + 0.1 and rest.min() > left - 0.1


def test_what_is_not_seen_teaches_nothing() -> None:
    state = new_session()
    for _ in range(100):
        state = learned(np.zeros(2, np.float32), AHEAD, np.zeros(2, bool), state)
    before, after = new_session().calibration(), state.calibration()
    assert before == after


@pytest.mark.parametrize("lost", [(0,), (1,), (0, 1)])
@pytest.mark.parametrize("start", [10, 36, 300])
def test_a_camera_lost_for_a_moment_teaches_nearly_the_same(
    start: int, lost: tuple[int, ...]
) -> None:
    """Red before: the twin that never lost it had learned a quarter of a degree more."""
    rng = np.random.default_rng(2)
    aside = np.repeat(rng.choice([-0.17, 0.0, 0.17], (20, 2)), 25, 0).astype(np.float32)
    whole, broken = new_session(), new_session()
    for t in range(start + 40):
        gaze, lids = unit(USUAL + 0.05 + aside[t]), np.ones(2, np.float32)
        good = BOTH.copy()
        good[list(lost)] = not start <= t < start + 25
        whole = learned(lids, gaze, BOTH, whole)
        broken = learned(lids, gaze, good, broken)
        if t >= start + 25:
            away = np.subtract(broken.calibration().shift, whole.calibration().shift)
            assert np.abs(away).max() < 0.0012  # .07 degrees


def test_what_was_not_seen_for_long_is_not_known() -> None:
    state, _ = lived(np.ones(30), AHEAD)
    for _ in range(600):
        state = learned(np.ones(2, np.float32), AHEAD, np.zeros(2, bool), state)
    assert state.looks.max() == 30 + BRIEF


def test_eyes_shut_for_long_are_not_taken_for_open_ones() -> None:
    state, _ = lived(np.zeros(60 * FPS), AHEAD)
    assert state.calibration().open == new_session().calibration().open
