"""Articulation by classes of phones, on made-up mouths whose answers are known."""

import numpy as np
import pytest

from encoder.capture.speech.phones import Phone
from encoder.evaluation import articulation
from encoder.evaluation.articulation import MouthMotion, SpokenClip, teeth_seen_mm, tokens

STEPS = 120


def seen(top: float, bottom: float, upper: float, lower: float) -> float:
    heights = [np.full((1, 3), height) for height in (top, bottom, upper, lower)]
    return float(teeth_seen_mm(*heights)[0])


@pytest.mark.parametrize(
    ("top", "bottom", "upper", "lower", "mm"),
    [
        (0, 0, -1, 0.5, 0),  # lips shut over teeth that overlap
        (0.5, -0.5, 5, 6, 1),  # clenched: all of the opening is teeth
        (2, -4, -1, -1, 6),  # s: lips part over teeth edge to edge
        (0, -6, -1, -8, 1),  # a jaw that drops: a rim of the upper teeth above a dark gap
        (0, -6, -1, -4, 3),  # as far apart, with both rows
        (0, -6, 1, -8, 0),  # the upper lip covers the upper teeth
        (-1, 0, -2, -3, 0),  # lips pressed into each other
    ],
)
def test_what_is_open_is_teeth_but_for_the_gap_between_them(top, bottom, upper, lower, mm):
    assert seen(top, bottom, upper, lower) == pytest.approx(mm)


def mouth(opening: np.ndarray | float, **more: np.ndarray | float) -> MouthMotion:
    values = dict.fromkeys(articulation.MEASURES, 0.0) | {"opening": opening} | more
    return MouthMotion(**{k: np.broadcast_to(v, STEPS).astype(float) for k, v in values.items()})


def said(*names: str) -> list[Phone]:
    """Each of six frames."""
    return [Phone(name, 0.2 * i + 0.01, 0.2 * i + 0.21) for i, name in enumerate(names)]


def along(phones: list[Phone], values: dict[str, float]) -> np.ndarray:
    curve = np.repeat([values[phone.name] for phone in phones], 6)
    return np.pad(curve, (0, STEPS - len(curve)))


WORDS = said(*("pau", "s", "pau", "w", "pau", "aa") * 3)
OTHERS = said(*("w", "aa", "w", "aa", "w") * 2)
WIDTHS = {"pau": 0.0, "s": 4.5, "w": -5.9, "aa": 0.0}


def clip(talker: str, scale: float, offset: float = 0.0, words: list[Phone] = WORDS) -> SpokenClip:
    width = along(words, WIDTHS)
    shown = mouth(2, width=scale * width + offset)
    return SpokenClip(talker, shown, mouth(2, width=width), words)


def test_half_the_spread_of_classes_is_half_the_contrast_whoever_talks():
    spoken = [clip("one", 0.5, 7), clip("one", 0.5, 7), clip("two", 0.5, -3, OTHERS)]
    means = articulation.class_means(tokens(spoken))
    assert list(means) == ["s z", "w r", "a"]
    ratios = articulation.contrasts(means)
    assert ratios["width_contrast"] == pytest.approx(0.5)
    assert ratios["width_classes_r"] == pytest.approx(1)
    mirrored = articulation.class_means(tokens([clip("one", -1)] * 2))
    assert articulation.contrasts(mirrored)["width_classes_r"] == pytest.approx(-1)


def test_rare_classes_are_left_out():
    assert articulation.class_means(tokens([clip("one", 1)])) == {}


def test_width_beside_that_of_people():
    words = said("s", "pau", "iy", "pau", "w", "pau", "uw")
    values = articulation.PEOPLE_WIDTH_MM | {"pau": 0.0}
    width = along(words, {name: 0.5 * value for name, value in values.items()})
    told = tokens([SpokenClip("one", mouth(2, width=width + 3), mouth(2), words)] * 5)
    result = articulation.width_beside_people(told)
    assert result["width_over_people_shown"] == pytest.approx(0.5)
    assert result["width_over_people_tracked"] == pytest.approx(0)


def test_a_phone_is_measured_over_its_own_frames():
    opening = np.arange(STEPS) / 30
    told = tokens([SpokenClip("one", mouth(opening), mouth(0), [Phone("t", 1.001, 1.199)])])
    assert told.means[0, 0, 0] == pytest.approx(np.mean(np.arange(30, 35) / 30))
    assert told.least[0].tolist() == [1, 0]
    brief = tokens([SpokenClip("one", mouth(opening), mouth(0), [Phone("t", 1.001, 1.01)])])
    assert brief.means[0, 0, 0] == pytest.approx(29 / 30)


def test_teeth_count_only_where_the_tracked_mouth_shows_them():
    words = said("s", "pau", "z", "pau", "s", "pau", "t")
    tracked = np.zeros(STEPS)
    tracked[:18] = 2  # the first two
    shown = np.zeros(STEPS)
    shown[:6] = 2
    told = tokens([SpokenClip("one", mouth(4, teeth=shown), mouth(4, teeth=tracked), words)])
    result = articulation.shares(told)
    assert result["teeth_seen"] == 0.5 and result["teeth_seen_tracked"] == pytest.approx(2 / 3)


def test_shut_vowels_and_shut_tongue_sounds_are_counted():
    words = said("aa", "pau", "aa", "pau", "t", "pau", "d", "aa")
    shown = along(words, {"aa": 5, "pau": 0, "t": 0.2, "d": 0.2})
    shown[12:18] = 0.5  # the second vowel
    tracked = along(words, {"aa": 5, "pau": 0, "t": 3, "d": 0.2})
    shown[42:] = tracked[42:] = 0.5  # a third that nobody opens
    told = tokens([SpokenClip("one", mouth(shown), mouth(tracked), words)])
    result = articulation.shares(told)
    assert result["false_closures"] == 0.5
    assert result["tongue_shut"] == 1 and result["tongue_shut_tracked"] == 0.5


def test_clips_without_phones_have_no_figures():
    assert articulation.figures(tokens([SpokenClip("one", mouth(1), mouth(1), [])])) == {}
