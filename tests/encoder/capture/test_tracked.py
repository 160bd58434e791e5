"""Tracked curves: their neutral, their time, and what the rules lay over them."""

import numpy as np
import pytest

from encoder.capture.motion.articulation import articulated, in_sync, opening, tongue
from encoder.capture.motion.channels import JAW_OPEN, MOUTH_CLOSE, RIG_INDEX, RIG_NAMES
from encoder.capture.motion.rules import frame_times
from encoder.capture.motion.style import Style
from encoder.capture.speech import handling
from encoder.capture.speech.phones import Phone
from encoder.capture.speech.voice_like import VOICE_LIKE
from encoder.capture.subjects import tracked

ARKIT = ["jawOpen", "mouthClose", "mouthPucker"]
SAID = [
    Phone(name, 0.3 + 0.2 * k, 0.5 + 0.2 * k)
    for k, name in enumerate(("b", "aa", "s", "iy", "w", "aa", "f", "ay"))
]


def test_shut_lips_are_the_neutral_and_the_jaw_has_one_size():
    rng = np.random.default_rng(0)
    weights = np.zeros((4, 50, 3), np.float32)
    weights[..., 0] = 0.1 + 0.12 * (1 + np.sin(np.arange(50) * 0.7)) + 0.001 * rng.random((4, 50))
    weights[..., 2] = 0.3  # always puckered
    curves = tracked.speaker_curves(weights, ARKIT)
    assert curves[..., RIG_INDEX["mouthPucker"]].max() < 0.01
    assert curves[..., JAW_OPEN].min() < 0.02
    assert np.quantile(curves[..., JAW_OPEN], 0.98) == pytest.approx(tracked.JAW_LOUD, rel=0.02)


def test_lips_open_with_the_jaw_and_no_further_than_tracked():
    rng = np.random.default_rng(0)
    lower = [RIG_INDEX[f"mouthLowerDown_{side}"] for side in "LR"]
    curves = np.zeros((2, 60, len(RIG_NAMES)), np.float32)
    curves[..., JAW_OPEN] = 0.2 * rng.random((2, 60))
    curves[..., lower] = 0.02 * rng.random((2, 60, 1))
    moved = tracked.with_lips(curves)
    np.testing.assert_allclose(opening(moved), opening(curves), atol=1e-5)
    assert np.quantile(moved[..., lower], 0.9) > 5 * np.quantile(curves[..., lower], 0.9)
    assert (moved[..., JAW_OPEN] >= tracked.JAW_LEAST * curves[..., JAW_OPEN] - 1e-6).all()


def test_the_tongue_shows_for_th_and_rises_for_l():
    said = [Phone("th", 0.4, 0.6), Phone("aa", 0.6, 0.9), Phone("l", 0.9, 1.1)]
    moved, times = tongue(said, 45, Style()), frame_times(45)
    at = {
        phone.name: moved[np.abs(times - (phone.start + phone.end) / 2) < 0.04].max(0)
        for phone in said
    }
    assert at["th"][0] > 0.4 > 0.1 > at["l"][0]
    assert at["l"][1] > 0.7 > 0.4 > at["aa"][1]


def test_labels_are_read_where_they_are_true():
    ramp = np.arange(75)[:, None] / 25.0
    at = tracked.at_ticks(ramp, 25, 48_000 * 2)[:, 0]
    np.testing.assert_allclose(at[5:], frame_times(60)[5:] - tracked.LABEL_LATE_S, atol=1e-6)


def test_the_rules_add_closures_and_tucks_and_leave_opening_and_width():
    rig = np.zeros((70, len(RIG_NAMES)), np.float32)
    rig[10:60, JAW_OPEN] = 0.2
    made = articulated(rig, SAID, Style(), None)
    times = frame_times(70)
    widths = ("mouthStretch_L", "mouthDimple_R", "mouthPucker", "mouthFunnel")

    def during(number: int) -> np.ndarray:
        phone = SAID[number]
        return (times >= phone.start + 0.05) & (times < phone.end - 0.07)

    for number in (3, 4):  # iy and w, which the rules widen and round
        free = during(number)
        assert not made[free][:, [RIG_INDEX[name] for name in widths]].any()
        np.testing.assert_allclose(made[free, JAW_OPEN], 0.2, rtol=0.03)
    assert made[during(6), RIG_INDEX["mouthRollLower"]].max() > 0.4
    held = (times > 0.35) & (times < 0.4)  # of the b
    assert opening(made)[held].min() < 0.02 < opening(rig)[held].min()
    vowel = (times >= SAID[1].start + 0.1) & (times < SAID[1].end)
    np.testing.assert_allclose(opening(made)[vowel], opening(rig)[vowel], rtol=0.03)
    assert made[vowel, MOUTH_CLOSE].max() < 0.02


def test_sync_knows_lips_that_come_late_or_do_something_else():
    rig = articulated(np.zeros((70, len(RIG_NAMES)), np.float32), SAID, Style(), None)
    times = frame_times(70)
    for phone, size in zip(SAID, (0, 0.3, 0.05, 0.15, 0.05, 0.3, 0.05, 0.3), strict=True):
        rig[(times >= phone.start) & (times < phone.end), JAW_OPEN] = size
    assert in_sync(rig, SAID, Style())
    assert not in_sync(np.roll(rig, 8, 0), SAID, Style())
    noise = rig.copy()
    noise[:, JAW_OPEN] = 0.2 * np.random.default_rng(1).random(70)
    assert not in_sync(noise, SAID, Style())


@pytest.mark.parametrize("make", [*handling.HANDLING, *VOICE_LIKE])
def test_sounds_that_are_no_voice_are_loud_and_never_the_same(make):
    one, other = (make(24_000, np.random.default_rng(seed)) for seed in (0, 1))
    assert one.shape == (24_000,) and np.isfinite(one).all() and 0.3 < one.std() < 3
    assert not np.array_equal(one, other)
