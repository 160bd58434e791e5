"""What a chain learns to hear phones from: whose clips count how much, and who talks beside."""

import numpy as np
import pytest
from training_material import FACE, spoken

from encoder.training.mouth import Mouth
from encoder.training.streams.augment import distort
from encoder.training.streams.pieces import (
    EARLY,
    SpokenPieces,
    earlier,
    phone_weights,
    voice_weights,
)
from encoder.training.streams.spoken import REST, RULES, Crowd
from sensors.types import InputError

pytestmark = pytest.mark.slow


def test_rare_phones_weigh_more_and_unknown_ones_as_silence() -> None:
    weight = phone_weights(np.repeat([-1, 0, 1, 2], [50, 60, 30, 10]), 0.4)
    assert weight[0] < weight[1] < weight[2] and weight[-1] == weight[0]
    assert np.average(weight[:3], weights=[60, 30, 10]) == pytest.approx(1)
    np.testing.assert_allclose(phone_weights(np.arange(3), 0.0), 1)


def test_a_talker_counts_as_the_root_of_how_much_there_is() -> None:
    voice = np.repeat(["anna", "ben", RULES, REST], [400, 100, 30, 20])
    weight = voice_weights(voice, 0.1, 0.2)
    shares = [weight[voice == name].sum() for name in ("anna", "ben", RULES, REST)]
    np.testing.assert_allclose(shares, np.array([2, 1, 0.3, 0.6]) / 3.9, rtol=1e-6)


def test_who_is_left_out_is_gone_clip_by_clip() -> None:
    frames = spoken({"anna": 30, "ben": 25, REST: 10}, dim=1)
    frames.heard[:, 0] = np.arange(65)
    left = frames.without(("anna",))
    np.testing.assert_array_equal(left.heard[:, 0], np.arange(30, 65))
    assert left.lengths.sum() == 35 and set(left.voice.tolist()) == {"ben", REST}
    assert frames.without(()) is frames
    with pytest.raises(InputError, match="--leave-out: expected one of anna, ben, got 'dan'"):
        frames.without(("dan",))


def test_pieces_are_of_one_clip_and_of_nobody_who_is_left_out() -> None:
    frames = spoken({"anna": 30, "ben": 25, REST: 10}, dim=1)
    frames.heard[:, 0] = np.arange(65)
    left = frames.without(("anna",))
    pieces = SpokenPieces(left, Mouth.of(FACE), batch=64, length=12, rules=0.0, rest=1.0)
    heard, _, truth, _, voiced, there = pieces.draw(np.random.default_rng(0))
    rows = heard[..., 0][there > 0].long()
    assert set(rows.tolist()) == set(range(30, 65))
    np.testing.assert_array_equal(truth[there > 0], pieces.truth[rows - 30])
    assert (voiced[there > 0][rows >= 55] == 0).all() and (voiced[there > 0][rows < 55] != 0).all()


def test_lips_are_asked_early_and_never_by_the_next_clip() -> None:
    truth = np.array([[0, 1], [4, 1], [4, 9], [80, 0], [0, 0]], np.float32)
    found = earlier(truth, np.array([3, 1, 1]))
    np.testing.assert_allclose(found[:2], [[4 * EARLY, 1], [4, 1 + 8 * EARLY]])
    np.testing.assert_array_equal(found[2:], truth[2:])
    assert found.dtype == np.float32
    pieces = SpokenPieces(
        spoken({RULES: 30, REST: 25}), Mouth.of(FACE), batch=4, length=12, rules=1.0, rest=1.0
    )
    plain = pieces.mouth.face.rig_to_code(pieces.frames.rig.astype(np.float32)) @ pieces.mouth.read
    wanted = earlier(plain, pieces.frames.lengths)
    np.testing.assert_allclose(pieces.truth, wanted, atol=1e-4)


def test_other_people_talk_below_the_talker() -> None:
    rng = np.random.default_rng(0)
    tone = (8000 * np.sin(np.arange(9000) * 0.3)).astype(np.int16)
    crowd = Crowd([tone, rng.integers(-900, 900, 30_000).astype(np.int16)])
    voices = crowd.talk(24_000, rng)
    assert voices.shape == (24_000,) and voices.std() == pytest.approx(1, rel=0.02)
    talker = 0.1 * np.sin(np.arange(24_000) * 0.5)
    off = [
        distort(talker, np.random.default_rng(k), 0.3, crowd.talk)
        - distort(talker, np.random.default_rng(k), 0.3, lambda n, rng: 0 * crowd.talk(n, rng))
        for k in range(40)
    ]
    assert 0.2 < np.mean([np.abs(x).max() > 1e-3 for x in off]) < 0.7
