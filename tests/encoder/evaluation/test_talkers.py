"""Figures of talkers left out, on lips whose answers are known."""

import numpy as np
import pytest

from encoder.capture.speech.phones import Phone
from encoder.evaluation import talkers
from encoder.evaluation.metrics import LipMarks

TIMES = np.arange(120) / 30
MARKS = LipMarks((0, 1), (2, 3), np.array([[2, 3]]))


def lips(opening: np.ndarray, width: np.ndarray) -> np.ndarray:
    """Two corners, and an upper and a lower lip."""
    result = np.zeros((len(opening), 4, 3), np.float32)
    result[:, 0, 0], result[:, 1, 0] = width / 2, -width / 2
    result[:, 2, 1] = opening
    return result


def opening(shift_s: float = 0.0) -> np.ndarray:
    return 4 * (1 - np.cos(2 * np.pi * 1.5 * (TIMES - shift_s)))


WIDTH = 48 + np.sin(2 * np.pi * 0.8 * TIMES)


def test_lips_that_are_late_are_found_late_to_a_few_milliseconds():
    take = talkers.TalkerClip(lips(opening(0.04), WIDTH), lips(opening(), WIDTH), [])
    figures = talkers.figures([take], MARKS)
    assert figures["shift_ms"] == pytest.approx(40, abs=5) and figures["r_best"] > 0.99
    assert figures["r"] < 0.96 and figures["r_fast"] == pytest.approx(figures["r"], abs=0.05)


def test_half_the_motion_is_seen_in_size_and_not_in_r():
    take = talkers.TalkerClip(lips(opening() / 2, 24 + WIDTH / 2), lips(opening(), WIDTH), [])
    figures = talkers.figures([take], MARKS)
    assert figures["r"] == pytest.approx(1) and figures["p95_ratio"] == pytest.approx(0.5, rel=0.01)
    assert figures["width_r"] == pytest.approx(1)
    assert figures["width_ratio"] == pytest.approx(0.5, rel=0.01)


def test_closures_are_counted_at_the_start_and_inside():
    said = [Phone("pau", 0, 0.6), Phone("b", 0.6, 0.7), Phone("aa", 0.7, 1.0), Phone("m", 1.0, 1.1)]
    take = talkers.TalkerClip(
        lips(opening(), WIDTH), lips(opening(), WIDTH), said
    )  # shut at 0.67, 1.33
    assert talkers.closures([take], MARKS) == {"initial": (1, 1), "inside": (0, 1)}
    figures = talkers.figures([take], MARKS)
    assert figures["shut_initial"] == 1 and figures["shut_inside"] == 0
