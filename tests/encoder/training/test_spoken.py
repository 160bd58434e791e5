"""What a chain learns to hear phones from: whose clips count how much, and who talks beside."""

import numpy as np
import pytest
from training_material import FACE, spoken

from encoder.capture import dataset
from encoder.capture.dataset import PACK_RATE, make_clip
from encoder.capture.motion.channels import RIG_NAMES
from encoder.training.mouth import Mouth
from encoder.training.streams import spoken as stream
from encoder.training.streams.augment import Crowd, clicks, distort, on_and_off
from encoder.training.streams.pieces import (
    EARLY,
    SpokenPieces,
    earlier,
    phone_weights,
    voice_weights,
)
from encoder.training.streams.spoken import REST, RULES, TRACKED_DB, hear_among, hear_pack
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
    for talk in (*[crowd.talk] * 6, crowd.in_syllables):
        voices = talk(24_000, rng)
        assert voices.shape == (24_000,) and voices.std() == pytest.approx(1, rel=0.02)
    talker = 0.1 * np.sin(np.arange(24_000) * 0.5)
    off = [
        distort(talker, np.random.default_rng(k), 0.3, crowd.talk)
        - distort(talker, np.random.default_rng(k), 0.3, lambda n, rng: 0 * crowd.talk(n, rng))
        for k in range(40)
    ]
    assert 0.2 < np.mean([np.abs(x).max() > 1e-3 for x in off]) < 0.7


def runs(on: np.ndarray) -> np.ndarray:
    """Seconds of each run of True, without those at the ends."""
    ends = np.flatnonzero(np.diff(on))
    return np.diff(ends)[(0 if on[ends[0] + 1] else 1) :: 2] / PACK_RATE


def test_syllables_and_pauses_are_as_long_as_people_make_them() -> None:
    rng = np.random.default_rng(0)
    gates = [on_and_off(20 * PACK_RATE, rng) for _ in range(10)]
    for state, (least, most) in ((True, (0.1, 0.5)), (False, (0.05, 0.6))):
        found = np.concatenate([runs((gate > 0.5) == state) for gate in gates])
        assert least - 1e-3 < found.min() < least + 0.05 < most - 0.05 < found.max() < most + 1e-3
    assert len({gate[0] for gate in gates}) > 1  # not all start with the same
    gate = gates[0]
    rise = np.pi / 2 / 0.01 / PACK_RATE  # the steepest of an edge of 10 ms
    assert np.abs(np.diff(gate)).max() == pytest.approx(rise, rel=0.05)
    assert 0 <= gate.min() < gate.max() <= 1


def test_half_of_the_others_talk_in_syllables_and_each_voice_in_its_own() -> None:
    rng = np.random.default_rng(0)
    crowd = Crowd([(8000 * rng.choice([-1, 1], 90_000)).astype(np.int16)])  # never silent

    def silent(sound: np.ndarray) -> bool:
        return bool((np.abs(sound) < 1e-6).mean() > 0.02)

    alone = [silent(crowd.in_syllables(4 * PACK_RATE, rng)) for _ in range(60)]
    mixed = [silent(crowd.talk(4 * PACK_RATE, rng)) for _ in range(200)]
    assert 0.6 < np.mean(alone) < 1  # six voices leave no pause to all
    assert np.mean(mixed) == pytest.approx(np.mean(alone) / 2, abs=0.1)


def parts(monkeypatch: pytest.MonkeyPatch, noises: int = 0) -> list[tuple]:
    """What is heard of nine clips of anna's, one of ben's and one made by rules."""
    tone, gaze = 0.1 * np.sin(np.arange(48_000) * 0.1), np.tile([0.0, 0.0, 1.0], (30, 2, 1))
    clips = [
        make_clip(tone, np.zeros((30, len(RIG_NAMES))), gaze, np.ones(30), truth=truth, voice=voice)
        for truth, voice in [("tracked", "anna")] * 9 + [("tracked", "ben"), ("rules", "made")]
    ]
    monkeypatch.setattr(stream, "iter_pack", lambda pack, split: clips)
    monkeypatch.setattr(stream, "RULES_KEPT", 1.0)
    return list(stream._parts(None, 0, 1, noises))


def test_who_has_few_clips_is_heard_plain_beside_talk_and_beside_syllables(monkeypatch) -> None:
    asked = []
    for name in ("talk", "in_syllables"):
        monkeypatch.setattr(
            Crowd, name, lambda self, count, rng, name=name: asked.append(name) or np.ones(count)
        )
    plain = [voice for _, voice, _, plain in parts(monkeypatch) if plain]
    assert plain == ["ben"] * 3 and asked[-2:] == ["talk", "in_syllables"]


def test_others_are_nearer_to_tracked_talkers_than_to_made_ones(monkeypatch) -> None:
    crop, below = stream.crop, []

    def watched(clip, frames, rng, p, others, others_db):
        below.append((clip.truth, others_db))
        return crop(clip, frames, rng, p, others, others_db)

    monkeypatch.setattr(stream, "crop", watched)
    parts(monkeypatch)
    assert set(below) == {("tracked", TRACKED_DB), ("rules", (3, 26))}
    sound, rng = np.zeros(24_000), np.random.default_rng
    sound[::2] = 0.1
    near = [
        [np.abs(distort(sound, rng(k), 0.3, crowd_of_one, db)).max() for k in range(40)]
        for db in ((0, 0), (60, 60))
    ]
    assert np.mean(near[0]) > 1.2 * np.mean(near[1])


def test_tracked_clips_are_heard_further_among_others_half_of_them_plain(monkeypatch) -> None:
    monkeypatch.setattr(Crowd, "talk", lambda self, count, rng: np.ones(count))
    parts(monkeypatch)  # puts the clips in place
    heard = list(stream._among_parts(None, 0))
    assert [voice for _, voice, _, _ in heard] == ["anna"] * 18 + ["ben"] * 6
    assert [plain for *_, plain in heard] == [True, False] * 12
    below = [20 * np.log10(part.audio.std() / part.audio.mean()) for part, *_ in heard]
    low, high = stream.AMONG_DB
    assert low - 0.5 < min(below) < low + 3 and high - 3 < max(below) < high + 0.5


def test_a_talker_who_says_nothing_for_long_is_not_heard() -> None:
    frames = spoken({"anna": 30, "ben": 25, RULES: 30, REST: 10})
    frames.phones[:] = 0
    frames.phones[[10, 29, 60]] = 5
    frames.phones[50:55] = -1
    pieces = SpokenPieces(frames, Mouth.of(FACE), batch=4, length=12, rules=1.0, rest=1.0)
    assert (pieces.voiced[[10, 29, 60]] == 1).all() and (pieces.voiced[85:] == 0).all()
    near = np.r_[6:10, 11:15, 25:29]
    assert (pieces.voiced[near] == -1).all()
    assert (pieces.voiced[np.r_[0:6, 15:25, 30:50]] == 0).all()  # ben's begin is a clip of its own
    assert (pieces.voiced[56:60] == -1).all() and (pieces.voiced[65:85] == 0).all()


def crowd_of_one(count: int, rng: np.random.Generator) -> np.ndarray:
    return rng.standard_normal(count)


def test_every_fifth_sound_without_a_voice_is_of_clicks(monkeypatch) -> None:
    def silent_but_for_clicks(count, rng, kinds):
        return np.full(count, float(kinds == (clicks,)), np.float32)

    monkeypatch.setattr(stream, "not_speech", silent_but_for_clicks)
    rest = [part.audio[0] for part, voice, _, _ in parts(monkeypatch, 10) if voice == REST]
    assert len(rest) == 10 and sum(rest) == 2


class Deaf:
    """Ears that hear nothing; the number of what they were asked to hear."""

    asked = 0

    def hear(self, audio: np.ndarray, *_: object) -> tuple[np.ndarray, np.ndarray]:
        self.asked += 1
        frames = len(audio) // (PACK_RATE // 30)
        return np.zeros((frames, 4)), np.zeros((frames, 256))


def test_a_pack_without_tracked_talkers_is_heard_and_what_was_cut_is_heard_anew(tmp_path):
    """Red before: TypeErrors of what had no rows, tracebacks of a file that a full disk had cut."""
    clip = make_clip(
        np.zeros(1600 * 40), np.zeros((40, len(RIG_NAMES))), np.zeros((40, 2, 3)), np.zeros(40),
        truth="rest", voice="none",
    )  # fmt: skip
    shard = dataset.write_shard(tmp_path / "one", [clip])
    dataset.write_manifest(tmp_path, [shard], {})
    ears, more = Deaf(), {"seed": 0, "versions": 1, "noises": 1, "resumed": False}
    assert hear_among(tmp_path, ears, "recipe", seed=0, resumed=False) is None  # type: ignore[arg-type]
    first = hear_pack(tmp_path, ears, "recipe", **more)  # type: ignore[arg-type]
    assert len(first.lengths) == ears.asked == 2
    made = tmp_path / "spoken.npz"
    made.write_bytes(made.read_bytes()[:900])
    again = hear_pack(tmp_path, ears, "recipe", **more)  # type: ignore[arg-type]
    assert ears.asked == 4 and np.array_equal(again.rig, first.rig)
    hear_pack(tmp_path, ears, "recipe", **more | {"resumed": True})  # type: ignore[arg-type]
    assert ears.asked == 4
    with pytest.raises(InputError, match="--resume: expected what that run heard in .*spoken"):
        # red before: what it heard was lost, and hours, before its state was refused
        hear_pack(tmp_path, ears, "recipe", **more | {"resumed": True, "versions": 2})  # type: ignore[arg-type]
