"""Lip widths of talkers are of one size; rest, opening and made speech stay as they are."""

import numpy as np
import torch
from training_material import FACE, spoken

from encoder.denoiser.config import MOUTH
from encoder.training.mouth import Mouth
from encoder.training.streams.lip_width import APART_MM, levelled
from encoder.training.streams.pieces import SpokenPieces
from encoder.training.streams.spoken import REST, RULES

FACE_MOUTH = Mouth.of(FACE)
NAMES = ("anna", "ben", RULES, REST)
voice = np.repeat(NAMES, 200)
SIZE = {"anna": (3.0, 1.0), "ben": (-1.0, 3.0), RULES: (5.0, 0.5), REST: (0.0, 0.0)}


def truths() -> np.ndarray:  # [800, MOUTH]
    """Talkers whose lips have the means and deviations of SIZE, mm."""
    ways = np.linalg.pinv(FACE_MOUTH.lips.numpy().astype(np.float64))
    draw = np.random.default_rng(0).standard_normal((len(voice), 2))
    middle, spread = np.array([SIZE[name] for name in voice.tolist()]).T
    spans = np.stack([4 + draw[:, 0], middle + spread * draw[:, 1]], 1)
    spans[voice == REST] = 0
    return (spans @ ways).astype(np.float32)


def spans(truth: np.ndarray) -> np.ndarray:
    return FACE_MOUTH.spans(torch.from_numpy(truth)).numpy()


def test_widths_of_all_talkers_get_one_mean_and_deviation() -> None:
    truth, speaking = truths(), np.ones(len(voice), bool)
    before, after = spans(truth), spans(levelled(truth, voice, speaking, FACE_MOUTH))
    np.testing.assert_allclose(after[:, 0], before[:, 0], atol=2e-3)
    own = np.array([[f(before[voice == n, 1]) for f in (np.mean, np.std)] for n in NAMES[:2]])
    for name in NAMES[:2]:
        width = after[voice == name, 1]
        np.testing.assert_allclose([width.mean(), width.std()], own.mean(0), atol=5e-3)
        r = np.corrcoef(width, before[voice == name, 1])[0, 1]
        assert r > 0.999
    for name in (RULES, REST):
        np.testing.assert_array_equal(after[voice == name], before[voice == name])


def test_what_is_no_speech_has_no_say_and_rest_stays_rest() -> None:
    truth, speaking = truths(), np.arange(len(voice)) % 4 < 2
    silent = np.flatnonzero((voice == "anna") & ~speaking)
    rest, half, open_ = silent[:20], silent[20:40], silent[40:]
    opened = np.linalg.pinv(FACE_MOUTH.lips.numpy())[0]  # by one mm
    truth[rest] = 0
    for rows, size in ((half, 0.5 * APART_MM), (open_, 2 * APART_MM)):
        truth[rows] += (size - spans(truth[rows])[:, :1]) * opened
    changed = levelled(truth, voice, speaking, FACE_MOUTH)
    assert not changed[rest].any()
    more = spans(changed)[:, 1] - spans(truth)[:, 1]
    said = speaking & (voice == "anna")
    slope, offset = np.polyfit(spans(truth)[said, 1], more[said], 1)  # what speech gets
    whole = slope * spans(truth)[:, 1] + offset
    np.testing.assert_allclose(more[half], 0.5 * whole[half], atol=0.02, rtol=0.02)
    np.testing.assert_allclose(more[open_], whole[open_], atol=0.02, rtol=0.02)


def test_pieces_have_levelled_widths() -> None:
    frames = spoken({"anna": 200, "ben": 200, RULES: 40, REST: 40})
    frames.rig[:200] *= 0.5
    pieces = SpokenPieces(frames, FACE_MOUTH, batch=4, length=20, rules=0.3, rest=0.3)
    width = spans(pieces.truth)[:, 1]
    said = [width[(frames.voice == name) & (pieces.voiced == 1)] for name in ("anna", "ben")]
    np.testing.assert_allclose(said[0].mean(), said[1].mean(), rtol=0.01)
    np.testing.assert_allclose(said[0].std(), said[1].std(), rtol=0.01)


def test_without_a_tracked_talker_nothing_changes() -> None:
    truth = np.ones((4, MOUTH), np.float32)
    made, spoken_ = np.array([RULES, RULES, REST, REST]), np.array([True, True, False, False])
    np.testing.assert_array_equal(levelled(truth, made, spoken_, FACE_MOUTH), truth)
