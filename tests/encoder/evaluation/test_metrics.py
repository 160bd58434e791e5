"""Figures with known answers: what the paper's columns and the causal model's extras compute."""

import numpy as np
import pytest

from encoder.capture.motion.shift import best_shift
from encoder.evaluation import metrics
from encoder.evaluation.metrics import LipMarks

# corners at +-20, inner lips touching at x = 0 and 5
LIPS = np.array([[20, 0, 0], [-20, 0, 0], [0, 0, 0], [0, 0, 0], [5, 0, 0], [5, 0, 0]], np.float32)
MARKS = LipMarks.find(LIPS, np.array([2, 4]), np.array([3, 5]))


def moved(row: int, offset: tuple[float, float, float], frames: int = 4) -> np.ndarray:
    """LIPS over `frames` frames, one vertex moved in the last."""
    lips = np.repeat(LIPS[None], frames, 0)
    lips[-1, row] += offset
    return lips


def test_lve_is_the_worst_vertex_of_a_frame():
    predicted = moved(2, (0, 3, 4))
    predicted[-1, 3] += (0, 1, 0)
    assert metrics.lip_vertex_error_mm(predicted, moved(2, (0, 0, 0))) == pytest.approx(5 / 4)


def test_velocity_error_ignores_a_constant_offset():
    rest, shifted = moved(2, (0, 0, 0)), moved(2, (0, 0, 0)) + 3
    assert metrics.lip_velocity_error_mm(shifted, rest) == 0
    assert metrics.lip_velocity_error_mm(moved(2, (0, 0, 2)), rest) == pytest.approx(2 / 3)


def test_fdd_compares_spreads():
    still = np.zeros((10, 2, 3), np.float32)
    moving = still.copy()
    moving[:, 0, 1] = np.tile([0.0, 2.0], 5)
    assert metrics.upper_face_deviation_mm(still, still) == 0
    assert metrics.upper_face_deviation_mm(moving, still) == pytest.approx(1.0 / 2)


def test_lip_sync_adds_width_and_height():
    assert MARKS.corners == (0, 1) and MARKS.centres == (2, 3)
    rest = moved(2, (0, 0, 0))
    assert MARKS.sync_error_mm(moved(0, (4, 0, 0)), rest) == pytest.approx(1.0)
    assert MARKS.sync_error_mm(moved(3, (0, -8, 0)), rest) == pytest.approx(2.0)
    assert MARKS.sync_error_mm(rest + 5, rest) == 0


def test_opening_is_the_gap_of_the_inner_lips():
    lips = np.repeat(LIPS[None], 2, 0)
    lips[1, [3, 5], 1] -= 6
    assert MARKS.opening_mm(lips).tolist() == [0, 6]


def test_best_shift_finds_a_late_mouth():
    sound = np.random.default_rng(0).standard_normal(200)
    r, shift = best_shift(np.roll(sound, 2), sound)
    assert shift == 2 and r > 0.99
    assert best_shift(np.zeros(50), sound[:50])[0] == -1


def test_syllable_power_counts_its_band_only():
    time = np.arange(300) / 30
    slow, syllables = (2 * np.sin(2 * np.pi * hz * time) for hz in (0.5, 4.0))
    assert metrics.syllable_power(syllables) == pytest.approx(2.0, rel=1e-3)
    assert metrics.syllable_power(slow) < 1e-3


def test_closures_may_be_two_frames_late_but_not_four():
    truth, closing = np.full(40, 8.0), np.zeros(40, bool)
    closing[20:22] = True
    truth[20:22] = 0
    late = [np.roll(truth, k) for k in (0, 3, 5)]
    assert [metrics.closures(x, truth, closing) for x in late] == [(1, 1), (1, 1), (0, 1)]
    assert metrics.closures(truth, np.full(40, 8.0), closing) == (0, 0)


def test_false_closures_are_shut_open_vowels():
    truth, vowels = np.full(40, 8.0), np.zeros(40, bool)
    vowels[5:10] = vowels[20:25] = True
    guess = truth.copy()
    guess[22] = 0.2
    assert metrics.false_closures(guess, truth, vowels) == (1, 2)


def test_energy_distance_prefers_a_sampler_to_a_mean():
    rng = np.random.default_rng(0)
    truth = rng.standard_normal((200, 5))
    sampler, mean = rng.standard_normal((200, 5)), np.zeros((200, 5))
    assert abs(metrics.energy_distance(sampler, truth)) < 0.1
    assert metrics.energy_distance(mean, truth) > 0.5
