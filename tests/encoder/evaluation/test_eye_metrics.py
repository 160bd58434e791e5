"""Figures about eyes: blinks as events with their delay, angles, ranks."""

from __future__ import annotations

import numpy as np
import pytest

from encoder.evaluation.eye_metrics import (
    NO_BLINKS,
    angle_deg,
    closing_frames,
    compare_blinks,
    shut_frames,
)


def shut(*runs: tuple[int, int]) -> np.ndarray:
    frames = np.zeros(100, bool)
    for start, stop in runs:
        frames[start:stop] = True
    return frames


def test_blinks_are_counted_as_events() -> None:
    there = shut((10, 15), (30, 36), (60, 64), (80, 85))
    found = shut((10, 14), (31, 36), (45, 47), (79, 90))
    result = compare_blinks(found, there)
    assert (result.hits, result.missed, result.false) == (3, 1, 1)
    assert result.latencies == [0, 1, -1]
    assert result.f1 == pytest.approx(2 * 3 / (2 * 3 + 2))
    assert result.precision == result.recall == 0.75
    assert compare_blinks(there, there).f1 == 1


def test_one_long_blink_is_not_two() -> None:
    result = compare_blinks(shut((10, 40)), shut((10, 15), (30, 36)))
    assert (result.hits, result.missed, result.false) == (1, 1, 0)
    assert compare_blinks(shut((10, 12), (13, 15)), shut((10, 15))).latencies == [0]


def test_counts_add_up() -> None:
    one = compare_blinks(shut((10, 15)), shut((10, 15), (40, 45)))
    total = NO_BLINKS + one + one
    assert (total.hits, total.missed, total.latencies) == (2, 2, [0, 0])
    assert NO_BLINKS.f1 == NO_BLINKS.on_time == 1


def test_on_time_is_within_a_frame_of_all_that_were_there() -> None:
    there = shut((10, 15), (30, 36), (60, 64), (80, 85))
    assert compare_blinks(shut((11, 15), (29, 36), (62, 64)), there).on_time == 0.5


def test_shut_is_half_of_the_usual() -> None:
    lids = np.full(50, 0.8)
    lids[10:14] = (0.5, 0.3, 0.1, 0.45)
    assert np.flatnonzero(shut_frames(lids)).tolist() == [11, 12]


def test_a_half_blink_closes_no_eye() -> None:
    lids = np.full(50, 0.8)
    lids[10:14], lids[30:34] = (0.38, 0.3, 0.25, 0.39), (0.38, 0.3, 0.23, 0.39)
    assert np.flatnonzero(closing_frames(lids)).tolist() == [30, 31, 32, 33]
    assert shut_frames(lids).sum() == 8


def test_angles() -> None:
    assert angle_deg(np.array([0, 0, 1.0]), np.array([0, np.sin(0.1), np.cos(0.1)])) == (
        pytest.approx(np.degrees(0.1))
    )
