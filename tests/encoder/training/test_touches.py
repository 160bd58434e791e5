"""Losses of what must touch: f and v want the lip on the teeth, near enough in time, others not;
lips stay apart in what is said far from p, b and m."""

import pytest
import torch

from encoder.capture.speech.phones import PHONE_INDEX
from encoder.training import touches

COUNT = 9
THERE, RARITY = torch.ones(1, COUNT), torch.ones(len(PHONE_INDEX) + 1)


def at(*frames: int, value: float = 0.55) -> torch.Tensor:
    return torch.zeros(1, COUNT).index_fill(1, torch.tensor(frames, dtype=torch.int64), value)


def said(phone: str, frame: int = 4) -> torch.Tensor:
    phones = torch.full((1, COUNT), PHONE_INDEX["aa"])
    phones[0, frame] = PHONE_INDEX[phone]
    return phones


@pytest.mark.parametrize("frame", [2, 4, 6])
def test_a_lip_on_the_teeth_within_two_frames_is_not_loose(frame: int):
    found = touches.tucking(at(frame), at(4), said("f"), THERE, RARITY)
    assert found == {"loose": 0, "tucked": 0}


def test_a_lip_that_stays_loose_in_f_or_is_tucked_in_a_vowel_costs():
    half = touches.tucking(at(4, value=0.2), at(4), said("v"), THERE, RARITY)
    none = touches.tucking(at(), at(4), said("v"), THERE, RARITY)
    assert 0 < half["loose"] < none["loose"]
    early = touches.tucking(at(1), at(4), said("v"), THERE, RARITY)
    assert early["loose"] == none["loose"] and early["tucked"] > 0


def test_a_lip_on_the_teeth_where_the_truth_has_it_or_phones_are_unknown_is_free():
    true = at(4)
    assert touches.tucking(true, true, said("m"), THERE, RARITY)["tucked"] == 0
    unknown = torch.full((1, COUNT), -1)
    assert touches.tucking(true, at(), unknown, THERE, RARITY)["tucked"] == 0


def false(now: float, wanted: float, phones: torch.Tensor) -> float:
    shown, true = torch.full((1, COUNT), now), torch.full((1, COUNT), wanted)
    moved = torch.zeros(1, COUNT)
    return float(touches.meeting(shown, moved, true, phones, THERE, RARITY)["false"])


def all_of(phone: str) -> torch.Tensor:
    return torch.full((1, COUNT), PHONE_INDEX[phone])


def test_open_vowels_want_more_than_what_else_is_said():
    vowel, other = touches.OPEN_MM - 1, touches.PARTED_MM - 1
    assert false(1.0, 3.0, all_of("aa")) == pytest.approx(10 * vowel**2)
    for phone, wanted in (("aa", 2.0), ("t", 3.0), ("t", 0.0)):
        assert false(1.0, wanted, all_of(phone)) == pytest.approx(10 * other**2)
    assert false(touches.PARTED_MM, 0.0, all_of("t")) == 0


def test_lips_may_shut_near_m_in_silence_and_where_phones_are_unknown():
    assert false(0.0, 0.0, torch.zeros(1, COUNT, dtype=torch.int64)) == 0
    unknown = torch.full((1, COUNT), -1)
    assert false(0.0, 2.0, unknown) == 0 < false(0.0, 3.0, unknown)
    near = false(0.0, 0.0, torch.where(said("m") == PHONE_INDEX["m"], said("m"), all_of("t")))
    assert near == pytest.approx(4 / COUNT * false(0.0, 0.0, all_of("t")))
