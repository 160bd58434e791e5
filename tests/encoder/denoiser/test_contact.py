"""The contact head: what it measures, what it may move, that learning shuts lips, who follows."""

import json
import math
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from driver_material import networks

from encoder.audio.config import PRESETS as AUDIO
from encoder.audio.encoder import AudioEncoder
from encoder.backends import create_backend
from encoder.capture.motion.channels import JAW_OPEN, MOUTH_CLOSE
from encoder.denoiser.config import PRESETS, DenoiserConfig
from encoder.denoiser.contact import Contact
from encoder.denoiser.model import Denoiser, headless
from encoder.nn import checkpoint
from encoder.training import loop
from encoder.training.checkpoints import load_denoiser
from encoder.training.geometry import TrainingFace
from encoder.training.stages import contact
from sensors.types import InputError

TO_CODE = np.linalg.qr(np.random.default_rng(0).normal(size=(256, 53)))[0].T.astype(np.float32)
OPENS_MM = np.zeros(53, np.float32)
OPENS_MM[[JAW_OPEN, MOUTH_CLOSE]] = 20, -10


def gaps(codes: torch.Tensor) -> torch.Tensor:  # one pair of lips, apart along y
    y = codes @ torch.from_numpy(TO_CODE.T @ OPENS_MM)
    return torch.stack([0 * y, y, 0 * y], -1)[..., None, :]


FACE = TrainingFace(
    lambda rig: rig @ TO_CODE, gaps, torch.ones(1), gaps,
    lambda codes: gaps(codes)[..., 0, 1:2], lambda codes: codes,
    lambda codes: codes[..., :2],
)  # fmt: skip


def student(**more: Any) -> Denoiser:
    torch.manual_seed(1)
    model = Denoiser(replace(PRESETS["debug"], **more))
    model.expression_mean.normal_(std=0.05)
    model.expression_std.uniform_(0.1, 0.3)
    return model


def opening(model: Denoiser, x0: torch.Tensor) -> torch.Tensor:
    return gaps(model.unstandardise(x0))[..., 0, 1]


@pytest.mark.slow
def test_a_new_head_changes_nothing_and_measures_millimetres() -> None:
    model = student()
    head = contact.new_head(model, FACE, 8)
    x0, audio = torch.randn(2, 5, 256), torch.randn(2, 5, 512)
    assert torch.equal(head(x0, audio), x0)
    measured = x0 @ head.gap + head.rest
    torch.testing.assert_close(measured, opening(model, x0), atol=1e-4, rtol=1e-4)
    wider = opening(model, x0 + head.shut) - opening(model, x0)
    torch.testing.assert_close(wider, torch.ones(2, 5), atol=1e-4, rtol=1e-4)
    jaw = model.unstandardise(x0 + head.shut) - model.unstandardise(x0)
    rig = jaw.detach().numpy() @ TO_CODE.T
    assert np.abs(np.delete(rig, MOUTH_CLOSE, -1)).max() < 1e-4  # nothing else of the face


def lively(head: Contact, size: float = 1.0) -> Contact:
    for layer in (head.listen, head.move):
        torch.nn.init.normal_(layer.weight, std=0.05 * size)
    return head


@pytest.mark.parametrize("reach", [6.0, 2.5])
def test_it_moves_the_lips_no_farther_than_it_may(reach: float) -> None:
    head = lively(contact.new_head(student(reach_mm=reach), FACE, 8), 1e4)
    moved = head.moved_mm(3 * torch.randn(3, 9, 1), torch.randn(3, 9, 512))
    assert moved.abs().max() <= reach
    assert moved.abs().max() > reach - 0.01


def test_lips_far_apart_are_left_where_they_are() -> None:
    head = lively(contact.new_head(student(), FACE, 8), 1e4)
    audio = torch.randn(3, 9, 512)
    for gap, least, most in ((3.9, 5.9, 6.0), (5.0, 2.9, 3.0), (6.1, 0.0, 0.0)):
        moved = head.moved_mm(torch.full((3, 9, 1), gap), audio).abs()
        assert least <= moved.max() <= most + 1e-4


def test_a_scale_folded_in_is_the_scale_applied() -> None:
    head = lively(contact.new_head(student(), FACE, 8))
    x0, audio = torch.randn(1, 7, 256), 3 + 2 * torch.randn(1, 7, 512)
    mean, spread = torch.randn(512), 0.5 + torch.rand(512)
    expected = head(x0, (audio - mean) / spread)
    contact.fold_scale(head.listen, mean, spread)
    torch.testing.assert_close(head(x0, audio), expected, atol=1e-4, rtol=1e-4)


def test_lips_that_talk_stay_apart_where_no_closure_is_heard() -> None:
    """Not where a voice or the phones that are heard do not tell so, nor lips that are apart."""
    model = student()
    head = contact.new_head(model, FACE, 8)
    shut = -head.rest * head.gap / head.gap.square().sum()
    x0 = torch.stack([shut, shut + 3 * head.shut])[None]
    silent, heard = torch.full((1, 2, 512), -4.0), torch.full((1, 2, 512), -4.0)
    heard[..., 7] = 0.0  # one of the three
    torch.testing.assert_close(head(x0, silent), x0)  # nothing is known of phones
    for row, at in zip(head.closures, (5, 6, 7), strict=True):
        row[at] = 1
    gap = opening(model, x0)
    after = opening(model, head(x0, silent, torch.ones(1, 2, 1)))
    torch.testing.assert_close(after, torch.tensor([[1.2, 3.0]]), atol=1e-4, rtol=0)
    torch.testing.assert_close(head(x0, heard, torch.ones(1, 2, 1)), x0)
    torch.testing.assert_close(opening(model, head(x0, silent, torch.zeros(1, 2, 1))), gap)


@pytest.mark.parametrize(("emotion", "reach"), [(False, 6.0), (True, 6.0), (False, 2.5)])
def test_the_live_graph_has_the_head(emotion: bool, reach: float) -> None:
    plain = student(reach_mm=reach)
    model = Denoiser(replace(plain.config, contact=8))
    head = lively(contact.new_head(plain, FACE, 8), 3)
    torch.nn.init.normal_(head.closures, std=0.1)
    model.load_state_dict(
        plain.state_dict() | {f"contact.{k}": v for k, v in head.state_dict().items()}
    )
    rng, encoder = np.random.default_rng(2), AudioEncoder(AUDIO["debug"])
    felt = rng.normal(0, 0.2, 2 * sum(model.config.places)).astype(np.float32) if emotion else None
    frame = [rng.standard_normal(n).astype(np.float32) for n in (256, 512, 6)]
    found = {}
    for name, network in (("head", model), ("plain", plain)):
        for kind in ("torch", "onnx"):
            backend = create_backend(networks(encoder, network), kind)
            found[name, kind], _ = backend.denoise(*frame, backend.init_state(), felt)
        np.testing.assert_allclose(found[name, "onnx"], found[name, "torch"], atol=2e-4)
    assert np.abs(found["head", "onnx"] - found["plain", "onnx"]).max() > 1e-2


def test_a_card_says_how_far_a_head_reaches() -> None:
    """A card without it is from before it was in cards."""
    about = asdict(student(reach_mm=2.5, contact=8).config)
    assert checkpoint.config_from(DenoiserConfig, about).reach_mm == 2.5
    del about["reach_mm"]
    assert checkpoint.config_from(DenoiserConfig, about).reach_mm == 6.0


@pytest.mark.parametrize("reach", [0, -6.0, math.nan, 20.5, math.inf, "6", None, True])
def test_a_reach_that_no_lips_have_is_refused(reach: object) -> None:
    about = {**asdict(PRESETS["debug"]), "reach_mm": reach}
    with pytest.raises(InputError, match="reach_mm above 0 and up to 20, got .*; restore"):
        checkpoint.config_from(DenoiserConfig, about)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Sound that tells when lips are shut, a student that hears nothing, and what extends it."""
    rng, frames = np.random.default_rng(3), 120
    shut = np.stack([np.arange(frames) % 20 < 6] * 4)
    rig = np.zeros((4, frames, 53), np.float16)
    rig[..., JAW_OPEN] = 0.3 * ~shut
    features = rng.normal(0, 0.1, (4, frames, 512)) + shut[..., None]
    about = np.array(json.dumps({"sources": {}, "audio_sha256": "x"}))
    gaze = np.tile(np.float16([0, 0, 1, 0, 0, 1]), (4, frames, 1))
    np.savez(
        tmp_path / "streams.npz", features=features.astype(np.float16), rig=rig, gaze=gaze,
        about=about,
    )  # fmt: skip
    model = student()
    jaw = torch.from_numpy(0.15 * TO_CODE[JAW_OPEN])
    model.expression_mean.copy_(jaw)  # half open, whatever is said
    torch.nn.init.zeros_(model.output.weight)
    torch.nn.init.zeros_(model.output.bias)
    card = {"kind": "student", "config": asdict(model.config), "steps": 1, "seed": 0}
    checkpoint.save(tmp_path / "student", model.state_dict(), card)
    return tmp_path


def config(folder: Path, **more: object) -> contact.ContactConfig:
    run = loop.RunSettings(state=folder / "contact_state", average=0.9)
    settings = {"steps": 150, "frames": 40, "batch": 4, "rate": 1e-2}
    return contact.ContactConfig(
        streams=folder / "streams.npz", student=folder / "student", output=folder / "student",
        run=run, **settings | more,
    )  # type: ignore[arg-type]  # fmt: skip


@pytest.mark.slow
def test_it_learns_to_shut_lips_when_it_hears_that_they_are(folder: Path) -> None:
    before, _ = load_denoiser(folder / "student", "student")
    contact.run(config(folder), FACE)
    model, card = load_denoiser(folder / "student", "student")
    assert card["contact"]["steps"] == 150
    with np.load(folder / "streams.npz") as data:
        audio = torch.from_numpy(data["features"][:1].astype(np.float32))
    x, tau = torch.randn(1, 120, 256), torch.tensor([200])
    gaze = torch.tensor([0.0, 0, 1, 0, 0, 1]).expand(1, 120, 6)
    shut = (np.arange(120) % 20 < 6)[None]
    old, new = (opening(m, m(x, tau, audio, gaze)).detach().numpy() for m in (before, model))
    assert np.allclose(old, 3.0, atol=0.1)
    assert new[shut].mean() < 1.0 < 3.5 < new[~shut].mean()
    for name, tensor in headless(model).state_dict().items():  # up to eight bits
        torch.testing.assert_close(tensor, before.state_dict()[name], atol=2e-2, rtol=2e-2)


def test_each_loss_is_zero_at_the_truth_alone(folder: Path) -> None:
    model, settings = student(), config(folder)
    torch.nn.init.zeros_(model.output.weight)
    torch.nn.init.zeros_(model.output.bias)
    head = contact.new_head(model, FACE, 8)
    audio, gaze = torch.zeros(1, 30, 512), torch.zeros(1, 30, 6)
    scale = torch.zeros(512), torch.ones(512)

    def found(jaw: torch.Tensor) -> dict[str, float]:
        model.expression_mean.copy_(jaw[0])
        codes = jaw * (torch.arange(30) % 10 < 5)[:, None]  # shut now and then
        batch = codes[None], audio, gaze, torch.ones(1, 30)
        rows = contact.losses(head, model, batch, scale, FACE, settings)
        return {name: float(value.detach()) for name, value in rows.items()}

    wrong = found(torch.from_numpy(0.3 * TO_CODE[JAW_OPEN])[None])
    right = found(torch.zeros(1, 256))
    assert min(wrong[name] for name in ("contact", "gap", "spread")) > 0.1
    assert max(right.values()) < 1e-3
    parts = ("contact", "gap", "spread", "effort")
    total = sum(getattr(settings, f"{name}_weight") * wrong[name] for name in parts)
    assert wrong["total"] == pytest.approx(total, rel=1e-5)


def test_a_second_head_takes_the_place_of_the_first(folder: Path) -> None:
    contact.run(config(folder, steps=2), FACE)
    contact.run(config(folder, steps=2, hidden=5), FACE)
    model, card = load_denoiser(folder / "student", "student")
    assert card["config"]["contact"] == 5
    assert model.contact is not None
    assert model.contact.listen.out_features == 5


@pytest.mark.slow
def test_what_extends_the_student_follows_it(folder: Path) -> None:
    sha = checkpoint.load(folder / "student", "student")[1]["sha256"]
    cards = {
        "student_eyes": {"kind": "student", "config": {}, "audio_model": {"sha256": sha}},
        "emotion": {"kind": "emotion", "config": {}, "student_sha256": "of another student"},
    }
    for name, card in cards.items():
        (folder / f"{name}.json").write_text(json.dumps(card))
    base = folder / "student.json"
    card = json.loads(base.read_text())
    card["config"]["reach_mm"] = 2.5
    base.write_text(json.dumps(card))
    contact.run(config(folder, steps=2), FACE)
    now = checkpoint.load(folder / "student", "student")[1]["sha256"]
    eyes, emotion = (json.loads((folder / f"{name}.json").read_text()) for name in cards)
    assert now != sha
    assert eyes["audio_model"]["sha256"] == now
    assert eyes["config"] == {"contact": 32, "reach_mm": 2.5}
    assert emotion == cards["emotion"]
