"""Sounds that talkers left out are heard through."""

import numpy as np
import pytest

from app.eval.speech.leave_out import averaged, babble, check_enough, everyone_but, telephone
from sensors.types import InputError


def test_babble_is_10_db_below_and_other_voices_each_time() -> None:
    rng = np.random.default_rng(0)
    others = [rng.standard_normal(4000) for _ in range(20)]
    sound = rng.standard_normal(5000).astype(np.float32)
    change = babble(others, 3)
    first, second = change(sound) - sound, change(sound) - sound
    for noise in (first, second):
        assert abs(20 * np.log10(sound.std() / noise.std()) - 10) < 0.1
    assert abs(np.corrcoef(first, second)[0, 1]) < 0.9
    np.testing.assert_array_equal(babble(others, 3)(sound) - sound, first)


def test_nobody_talks_below_himself() -> None:
    sounds = {name: [np.full(3, k)] for k, name in enumerate("abc")}
    assert [int(sound[0]) for sound in everyone_but("b", sounds)] == [0, 2]


def test_figures_are_averaged_over_draws() -> None:
    assert averaged([{"r": 0.5, "shift_ms": -5.0}, {"r": 1.0, "shift_ms": 15.0}]) == {
        "r": 0.75,
        "shift_ms": 5.0,
    }


def test_a_telephone_passes_1_khz_and_stops_5() -> None:
    time = np.arange(48_000) / 48_000
    low, high = (telephone()(np.sin(2 * np.pi * hz * time)).std() for hz in (1000, 5000))
    assert low > 0.69 and high < 0.08


def test_one_talker_alone_is_told() -> None:
    """Red before: a traceback after minutes, as nobody was left to talk beside."""
    with pytest.raises(InputError, match="two talkers or more .* got grid-s2; run livedrive"):
        check_enough(["grid-s2"])
    check_enough(["grid-s2", "facegood"])
