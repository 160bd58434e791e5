"""The eyes stage: it resumes, overfits drawn eyes, and its distortions keep what they must."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from eye_material import drawn_eye

from encoder.eyes.encoder import load_eye_encoder
from encoder.eyes.format import PRESETS, RIG, SIDE, normalised, pixels
from encoder.eyes.network import EyeNet
from encoder.nn import checkpoint
from encoder.training import loop
from encoder.training.stages import eyes
from encoder.training.streams.eye_pictures import (
    EyePictures,
    augmented,
    moved,
    no_eyes,
    save_pairs,
    standard,
)
from sensors.types import InputError


def make(folder: Path, pairs: int = 60) -> Path:
    """Eyes that both look along x, drawn, of people one after the other; subject 9 is held out."""
    rng = np.random.default_rng(0)
    pictures, gaze, lids = [], [], []
    for _ in range(pairs):
        x, y, lid = rng.uniform((-0.3, -0.2, 0.3), (0.3, 0.2, 1))
        views = np.stack([drawn_eye(x, y, lid), drawn_eye(-x, y, lid)[:, ::-1]])
        pictures.append(pixels(views))
        gaze.append([[x, y, np.sqrt(1 - x * x - y * y)]] * 2)
        lids.append([lid, lid])
    rig = np.zeros((pairs, 2, 7), np.float32)
    rig[..., 0] = 1 - np.array(lids)
    save_pairs(
        folder / "eyes_0.npz", np.array(pictures), np.array(gaze), np.array(lids), rig,
        np.arange(pairs) * 10 // pairs,
    )  # fmt: skip
    return folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make(tmp_path_factory.mktemp("eyes"))


def test_right_eyes_become_left_ones(folder: Path) -> None:
    data = EyePictures.load(folder)
    assert len(data.lids) == 120
    x, y = data.gaze[1]  # of the right eye, mirrored
    drawn = pixels(np.stack([drawn_eye(x, y, data.lids[1])] * 2))[0]
    assert np.abs(data.pictures[1].astype(int) - drawn).mean() < 0.2
    assert data.gaze[0, 0] == -data.gaze[1, 0]
    assert (data.subject == np.repeat(np.arange(60) // 6, 2)).all()


def test_missing_and_odd_pictures_are_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="livedrive capture"):
        EyePictures.load(tmp_path)
    np.savez(tmp_path / "eyes_0.npz", pictures=np.zeros((1, 2, 5, 5)))
    with pytest.raises(InputError, match="capture again"):
        EyePictures.load(tmp_path)
    shapes = {"pictures": (1, 2, SIDE, SIDE), "gaze": (1, 2, 3), "lids": (1, 2), "subject": (1,)}
    arrays = {name: np.zeros(shape) for name, shape in shapes.items()}
    np.savez(tmp_path / "eyes_0.npz", **arrays, rig=np.zeros((1, 2, len(RIG))))
    np.savez(tmp_path / "eyes_1.npz", **arrays, rig=np.zeros((1, 2, len(RIG) + 1)))
    with pytest.raises(InputError, match=r"eyes_1.npz: expected rig"):
        EyePictures.load(tmp_path)


@pytest.mark.slow
def test_stage_writes_and_resumes(folder: Path, tmp_path: Path) -> None:
    config = eyes.preset(
        "debug",
        pictures=folder,
        output=tmp_path / "eyes",
        run=loop.RunSettings(state=tmp_path / "state"),
    )
    eyes.run(config)
    eyes.run(replace(config, steps=4, run=replace(config.run, resume=True)))
    _, card = checkpoint.load(tmp_path / "eyes", "eyes")
    assert card["steps"] == 4 and "heldout_gaze_deg_median" in card["metrics"]
    reading = load_eye_encoder(tmp_path)(np.zeros((2, 400, 400), np.uint8))
    assert np.isfinite(reading.features).all()


@pytest.mark.slow
def test_going_on_keeps_what_finds_and_measures_eyes(folder: Path, tmp_path: Path) -> None:
    run = loop.RunSettings(state=tmp_path / "state")
    first = eyes.preset("debug", pictures=folder, output=tmp_path / "first", run=run)
    eyes.run(first)
    begun, card = checkpoint.load(tmp_path / "first", "eyes")
    eyes.run(replace(first, start=first.output, output=tmp_path / "next", net=PRESETS["default"]))
    after, about = checkpoint.load(tmp_path / "next", "eyes")
    assert about["started_from"] == card["sha256"] and about["config"] == card["config"]
    kept = {name for name in begun if np.array_equal(begun[name], after[name])}
    others = {name for name in begun if name.startswith(("finder.", "meter."))}
    assert others <= kept and "project.weight" not in kept


@pytest.mark.slow
def test_learns_drawn_eyes(folder: Path) -> None:
    """Gaze and lid of a handful of pictures, without distortions."""
    torch.manual_seed(0)
    data = EyePictures.load(folder).where(np.arange(120) % 3 == 0)
    net = EyeNet(PRESETS["debug"])
    optimizer = loop.adamw({"net": net}, 5e-3)
    x = standard(torch.from_numpy(data.pictures).float())
    gaze, lids = torch.from_numpy(data.gaze), torch.from_numpy(data.lids)
    for _ in range(100):
        out = net(x)
        loss = (out.gaze - gaze).square().mean() / 0.04 + (out.lid - lids).square().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    net.eval()
    figures = eyes.judge(net, data)
    assert figures["heldout_gaze_deg_median"] < 3 and figures["heldout_lid_mae"] < 0.1


def test_losses_see_their_targets(folder: Path) -> None:
    data = EyePictures.load(folder)
    net = EyeNet(PRESETS["debug"])
    with torch.no_grad():
        net.relative.normal_(std=0.1)
    pairs = np.arange(16)
    torch.manual_seed(1)
    before = eyes.losses(net, data, pairs)
    wrong = replace(data, gaze=data.gaze + 0.3, lids=data.lids + 0.5, rig=data.rig + 1)
    torch.manual_seed(1)
    after = eyes.losses(net, wrong, pairs)
    for name in ("gaze", "pair", "lid", "rig"):
        assert after[name] > before[name] + 0.05
    relative = [float(losses["relative"].detach()) for losses in (before, after)]
    assert relative[0] == pytest.approx(relative[1])  # but for a constant
    before["total"].backward()
    later = ("meter", "finder")  # what the stage "wide-eyes" teaches
    assert all(p.grad is not None for n, p in net.named_parameters() if not n.startswith(later))


def test_what_cannot_be_seen_is_not_asked(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    data, net, pairs = EyePictures.load(folder), EyeNet(PRESETS["debug"]), np.arange(16)

    def loss(name: str, of: EyePictures) -> float:
        torch.manual_seed(1)
        return float(eyes.losses(net, of, pairs)[name].detach())

    some = np.arange(120) % 4 == 0  # left eyes, of every second pair
    open_ = replace(data, lids=np.ones_like(data.lids))
    shut = replace(data, lids=np.where(some, 0, open_.lids))
    gaze = data.gaze + 0.3 * some[:, None].astype(np.float32)
    for name in ("gaze", "pair"):
        asked = loss(name, replace(open_, gaze=gaze)) - loss(name, open_)
        hidden = loss(name, replace(shut, gaze=gaze)) - loss(name, shut)
        assert asked > 0.1 and abs(hidden) < 0.2 * asked
    other = data.gaze + 0.3 * np.roll(some, 1)[:, None].astype(np.float32)
    both = loss("pair", replace(shut, gaze=other)) - loss("pair", shut)
    assert abs(both) < 0.05  # where one eye is shut, the pair is asked of neither
    plain = eyes.augmented
    monkeypatch.setattr(eyes, "augmented", lambda *a, **k: (plain(*a, **k)[0], torch.zeros(64) > 0))
    torch.manual_seed(1)
    rows = eyes.losses(net, data, pairs)
    assert rows["valid"] > 0
    assert all(rows[n] == 0 for n in ("gaze", "pair", "relative", "lid", "rig", "synthesis"))


def test_distortions_are_bounded_and_standardised(folder: Path) -> None:
    data = EyePictures.load(folder)
    x, valid = augmented(data.pictures)
    assert x.shape == (120, 1, 100, 100) and x.abs().max() <= 3 and x.isfinite().all()
    assert 0.6 < valid.float().mean() <= 1
    expected, _ = normalised(data.pictures)
    assert np.abs(standard(torch.from_numpy(data.pictures).float()).numpy() - expected).max() < 1e-4


def test_moved_pictures_are_near_the_old_ones(folder: Path) -> None:
    """No picture leaves its frame: the pupil stays in it."""
    bright = torch.zeros(64, 100, 100)
    bright[:, 46:54, 46:54] = 1000.0
    after = moved(bright)
    assert (after.amax((1, 2)) > 500).all()
    place = after.flatten(1).argmax(1)
    rows, columns = place // 100, place % 100
    assert (rows - 50).abs().max() < 30 and (columns - 50).abs().max() < 30


def test_moments_of_one_person_are_moved_alike() -> None:
    x = torch.rand(4, 100, 100)
    after = moved(x.repeat(2, 1, 1), times=2)
    assert torch.equal(after[:4], after[4:]) and not torch.equal(after[:4], moved(x))


def test_every_kind_of_negative_is_no_left_eye() -> None:
    x = (torch.rand(1, 100, 100) * 200).repeat(7, 1, 1)
    other = no_eyes(x, torch.arange(7))
    assert all((a - b).abs().mean() > 3 for a, b in zip(x, other, strict=True))
    assert torch.equal(other[4], x[4].flip(1))


def test_spreads_are_those_of_the_features(folder: Path) -> None:
    torch.manual_seed(0)
    data, net = EyePictures.load(folder), EyeNet(PRESETS["debug"]).eval()
    eyes.fit_spreads(net, data)
    for spread in (net.frame_spread, net.subject_spread):
        assert spread.isfinite().all() and spread.abs().max() > 0
        assert torch.allclose(spread, spread.T, atol=1e-5)
    whole = net.frame_spread.clone()
    eyes.fit_spreads(net, data, count=24)  # of two people all frames, not of everybody one
    assert net.frame_spread.trace() > 0.5 * whole.trace()


def test_relative_gaze_is_right_but_for_a_constant_of_the_eye(folder: Path) -> None:
    """Of features that mix gaze with where each camera sits."""
    rng, net = np.random.default_rng(0), EyeNet(PRESETS["debug"]).eval()
    data = EyePictures.load(folder)
    side = np.arange(120) % 2
    gaze = rng.uniform(-0.26, 0.26, (120, 2)).astype(np.float32)
    cameras = rng.normal(0, 0.3, (10, 2, 2))[data.subject, side]
    mixed = np.concatenate([gaze + cameras, rng.normal(0, 1, (120, 78))], 1).astype(np.float32)

    def told(_: EyeNet, x: torch.Tensor) -> list[np.ndarray]:
        return [mixed[: len(x)]]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(eyes, "predict", told)
        seen = replace(data, gaze=gaze, lids=np.ones(120, np.float32))
        patch.setattr(eyes, "RELATIVE_RIDGE", 1e-3)
        eyes.fit_relative(net, seen)
    weight = net.relative.detach().numpy()
    off = mixed @ weight[:-1] + weight[-1] - gaze
    spread = [off[(data.subject == s) & (side == k)].std(0) for s in range(10) for k in (0, 1)]
    assert np.max(spread) < 0.01 and off.std() > 0.1 and np.abs(off.mean(0)).max() < 1e-3
