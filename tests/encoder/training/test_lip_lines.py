"""The straight lines of the lips: fair to talkers, taken into the direct path exactly. Lip widths
of talkers are of one size; rest, opening and made speech stay as they are."""

import numpy as np
import pytest
import torch
from training_material import FACE, spoken

from encoder.denoiser.config import MOUTH
from encoder.denoiser.direct import Direct
from encoder.training.mouth import Mouth
from encoder.training.streams import lip_lines
from encoder.training.streams.lip_lines import MOST, LipLines, fit_lines, fitted
from encoder.training.streams.lip_width import APART_MM, levelled
from encoder.training.streams.pieces import SpokenPieces
from encoder.training.streams.spoken import REST, RULES

FACE_MOUTH = Mouth.of(FACE)
NAMES = ("anna", "ben", RULES, REST)
voice = np.repeat(NAMES, 200)
SIZE = {"anna": (3.0, 1.0), "ben": (-1.0, 3.0), RULES: (5.0, 0.5), REST: (0.0, 0.0)}


def noise(seed: int, *shape: int) -> torch.Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed))


def test_lines_are_found_again() -> None:
    seen, lines = noise(0, 900, 12), noise(1, 12, 2)
    weight, offset = fit_lines(seen, seen @ lines + 3, np.repeat("anna", 900))
    drawn = 1 + torch.tensor(lip_lines.RIDGES)  # to zero: all components vary alike
    torch.testing.assert_close(weight, lines / drawn, atol=0.03, rtol=0.03)
    torch.testing.assert_close(offset, torch.tensor([3.0, 3.0]), atol=0.05, rtol=0)


def test_the_width_has_more_components_and_a_stronger_ridge() -> None:
    strength = torch.where(torch.arange(120) < 90, 3.0, 1.0)  # the first 90 are the opening's
    seen, line = noise(0, 4000, 120) * strength, noise(1, 120, 1).expand(-1, 2)
    weight, _ = fit_lines(seen, seen @ line, np.repeat("anna", 4000))
    opening, width = (weight * line).T
    assert opening[90:].abs().mean() < 0.1 < 0.8 < width[90:].mean() / line[90:, 0].square().mean()
    kept = [part[:90].sum() / line[:90, 0].square().sum() for part in (opening, width)]
    assert 0.99 < kept[0] < 1.01 and 0.96 < kept[1] < 0.98


def test_each_talker_counts_alike() -> None:
    seen, talkers = noise(0, 1000, 5), np.repeat(["anna", "ben"], [900, 100])
    opening = seen[:, 0] * torch.from_numpy(np.where(talkers == "ben", 3.0, 1.0)).float()
    weight, _ = fit_lines(seen, torch.stack([opening, opening], 1), talkers)
    assert 1.7 < weight[0, 0] < 2.3  # by frames it would be 1.2


def test_a_direct_path_takes_the_lines_in() -> None:
    direct, seen, ways = Direct(7, 256, 5), noise(0, 2, 9, 14), 0.5 * noise(1, 2, MOUTH)
    for tensor in direct.parameters():
        torch.nn.init.normal_(tensor, std=0.3)
    kept = torch.eye(MOUTH) - noise(2, MOUTH, 2) @ ways
    lines = LipLines(noise(3, 14, 2), torch.tensor([0.7, -0.4]), ways, kept)
    wanted = lines.beside(direct.said(seen), seen)
    lines.fold(direct)
    torch.testing.assert_close(direct.said(seen), wanted, atol=1e-4, rtol=1e-4)


def test_lip_lines_know_nobody_who_is_left_out() -> None:
    frames = spoken({"anna": 60, "ben": 60, RULES: 30})
    scale = torch.zeros(14), torch.ones(14)

    def line() -> LipLines:
        left = frames.without(("anna",))
        pieces = SpokenPieces(left, Mouth.of(FACE), batch=4, length=20, rules=0.3, rest=0.3)
        return LipLines.of(pieces, scale, (0.5, 0.5))

    before = line()
    frames.heard[:60] *= 3
    torch.testing.assert_close(line().weight, before.weight)
    frames.heard[60:120] *= 3
    assert not torch.allclose(line().weight, before.weight, rtol=0.1)
    frames.plain[:] = False
    np.testing.assert_allclose(line().ways, 0)  # nobody is left: the network alone


def test_lip_lines_hear_every_voice_and_no_noise() -> None:
    frames = spoken({"anna": 60, "ben": 60, "carl": 5000, RULES: 30, REST: 40})
    frames.plain[frames.voice != "anna"] = False  # the others have clips, none of them plain
    left = frames.without(("ben",))
    rows = fitted(left)
    assert {str(v) for v in left.voice[rows]} == {"anna", "carl", RULES}
    assert MOST <= (left.voice[rows] == "carl").sum() < 1.5 * MOST


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
    made, said = np.array([RULES, RULES, REST, REST]), np.array([True, True, False, False])
    np.testing.assert_array_equal(levelled(truth, made, said, FACE_MOUTH), truth)


@pytest.mark.parametrize("gains", [(1.0, 1.3), (1.2, 1.0), (1.2, 1.3)])
def test_lips_are_as_much_farther_apart_and_wider_as_the_gains_say(gains) -> None:
    truth = noise(0, 500, MOUTH)
    stretched = truth @ FACE_MOUTH.stretched(truth, gains)
    before, after = FACE_MOUTH.spans(truth), FACE_MOUTH.spans(stretched)
    torch.testing.assert_close(after, torch.tensor(gains) * before, atol=1e-3, rtol=1e-3)


def test_what_is_neither_opening_nor_width_is_scaled_on_its_own() -> None:
    truth = noise(0, 500, MOUTH)
    stretched = truth @ FACE_MOUTH.stretched(truth, (0.1, 0.3), 0.5)
    beyond = torch.eye(MOUTH) - FACE_MOUTH.lips @ FACE_MOUTH.ways(truth)
    for shown, wanted in (
        (FACE_MOUTH.spans(stretched), torch.tensor([0.1, 0.3]) * FACE_MOUTH.spans(truth)),
        (stretched @ beyond, 0.5 * truth @ beyond),
    ):
        torch.testing.assert_close(shown, wanted, atol=1e-2, rtol=1e-3)
