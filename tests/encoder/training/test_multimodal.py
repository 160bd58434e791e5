"""The multimodal stage: it begins as the audio model, keeps its mouth, and knows lost cameras."""

from __future__ import annotations

import json
import shutil
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
import torch
from eye_material import looks, net

from encoder.capture.motion.channels import RIG_INDEX, SPEECH_COLUMNS
from encoder.denoiser.config import PRESETS
from encoder.denoiser.model import Denoiser
from encoder.inference import load_student
from encoder.nn import checkpoint
from encoder.training import loop
from encoder.training.checkpoints import load_denoiser
from encoder.training.geometry import TrainingFace
from encoder.training.stages import multimodal
from encoder.training.stages.diffusion import fold_gaze
from encoder.training.streams import eyes as eye_streams
from sensors.types import InputError

pytestmark = pytest.mark.slow

rng = np.random.default_rng(0)
TO_CODE = rng.normal(0, 0.3, (53, 256)).astype(np.float32)
TO_VERTICES = torch.from_numpy(rng.normal(0, 0.1, (256, 12)).astype(np.float32))


def vertices(codes: torch.Tensor) -> torch.Tensor:
    return (codes @ TO_VERTICES).unflatten(-1, (4, 3))


def face() -> TrainingFace:
    return TrainingFace(
        lambda rig: rig.astype(np.float32) @ TO_CODE, vertices, torch.ones(4), vertices,
        lambda codes: codes[..., :2], lambda codes: codes, lambda codes: codes[..., :2],
    )  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Streams, an eye encoder and a gaze model, all small and random."""
    path = tmp_path_factory.mktemp("multimodal")
    rng, frames = np.random.default_rng(1), 150
    rig = np.zeros((4, frames, 53), np.float32)
    rig[..., RIG_INDEX["jawOpen"]] = rng.random((4, 1)) * (np.arange(frames) > 40)
    for side in "LR":
        rig[..., RIG_INDEX[f"eyeBlink_{side}"]] = np.arange(frames) % 40 < 6
    np.savez(
        path / "streams.npz", features=rng.normal(size=(4, frames, 512)).astype(np.float16),
        rig=rig.astype(np.float16),
        gaze=np.stack([looks(frames, s).reshape(-1, 6) for s in range(4)]).astype(np.float16),
        about=np.array(json.dumps({"sources": {}, "audio_sha256": "x"})),
    )  # fmt: skip
    torch.manual_seed(0)
    model = Denoiser(PRESETS["debug"])
    for block in model.blocks:
        torch.nn.init.normal_(block.modulate.weight, std=0.05)
    model.expression_std.fill_(0.3)
    card = {"kind": "student", "config": asdict(model.config), "steps": 1, "seed": 0}
    checkpoint.save(path / "student", fold_gaze(model).state_dict(), card)
    made = net()
    torch.nn.init.normal_(made.subject_spread, std=0.02)
    torch.nn.init.normal_(made.frame_spread, std=0.01)
    card = {"kind": "eyes", "config": asdict(made.config)}
    checkpoint.save(path / "eyes", made.state_dict(), card)
    return path


def config(folder: Path, out: Path) -> multimodal.MultimodalConfig:
    return multimodal.preset(
        "debug", streams=folder / "streams.npz", student=folder / "student",
        eyes=folder / "eyes", output=out / "student_eyes",
        run=loop.RunSettings(state=out / "state"),
    )  # fmt: skip


def streams_of(folder: Path, lost: float) -> eye_streams.EyeStreams:
    return eye_streams.EyeStreams(folder / "streams.npz", face(), net(), lost)


def test_stage_writes_a_model_of_eyes_and_resumes(folder: Path, tmp_path: Path) -> None:
    first = config(folder, tmp_path)
    multimodal.run(first, face())
    multimodal.run(replace(first, steps=4, run=replace(first.run, resume=True)), face())
    for suffix in (".json", ".safetensors"):
        shutil.copy(folder / f"student{suffix}", tmp_path)
    sizes, _, card = load_student(tmp_path, "eyes")
    assert sizes.condition == "eyes" and sizes.condition_dim == 160
    assert card["steps"] == 4 and "eyes_sha256" in card


def test_only_what_was_learned_is_written(folder: Path, tmp_path: Path) -> None:
    multimodal.run(config(folder, tmp_path), face())
    tensors, _ = checkpoint.load(tmp_path / "student_eyes", "student")
    base, base_card = checkpoint.load(folder / "student", "student")
    kept = [name for name in base if name not in tensors]
    assert "blocks.0.attention.qkv.weight" in kept and "blocks.1.up.weight" not in kept
    checkpoint.save(tmp_path / "student", base, {**base_card, "steps": 2})  # the same tensors
    _, weights, _ = load_student(tmp_path, "eyes")
    assert all(np.array_equal(weights[name], base[name]) for name in kept)
    checkpoint.save(tmp_path / "student", {k: v + 1 for k, v in base.items()}, base_card)
    with pytest.raises(InputError, match="train multimodal"):
        load_student(tmp_path, "eyes")


def test_batches_match_their_truth(folder: Path) -> None:
    streams = streams_of(folder, lost=0.0)
    batch = streams.draw(3, 60, np.random.default_rng(0))
    assert batch.e.shape == (3, 60, 160) and batch.e.abs().max() <= 1
    assert batch.audio.shape == (3, 60, 512) and batch.codes.shape == (3, 60, 256)
    blinking = batch.weight > 1
    assert 0.05 < blinking.float().mean() < 0.3  # 6 frames of 40
    left = batch.e[..., :80]
    gap = left[blinking].mean(0) - left[~blinking].mean(0)
    assert gap.abs().max() > 0.05  # e shows the blinks of its own frames
    assert np.array_equal(streams.draw(3, 60, np.random.default_rng(0)).codes, batch.codes)


def test_features_are_those_of_each_eye_as_its_cameras_are_lost(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made, steady = net(), torch.zeros(80, 80)
    gaze = torch.from_numpy(looks(50))[None]
    rig = torch.rand(1, 50, 2, 7)
    left_like = gaze[..., :2] * torch.tensor([[1.0, 1.0], [-1.0, 1.0]])
    blink = torch.zeros_like(rig)
    blink[..., 0] = rig[..., 0]

    def e(*gone: bool) -> torch.Tensor:  # [50, 2, 80]
        answers = iter(gone)
        lost = lambda frames, *_: torch.full((frames,), next(answers))  # noqa: E731
        monkeypatch.setattr(eye_streams, "_lost_frames", lost)
        rows = eye_streams.synthesised(made, gaze, rig, 0.3, np.random.default_rng(0))
        return rows[0].unflatten(-1, (2, 80))

    made.subject_spread, made.frame_spread = steady, steady
    with torch.no_grad():
        seen = made.synthesise(left_like, rig)[0]
        across = left_like.flip(2) * torch.tensor([-1.0, 1.0])
        moved = made.synthesise(across, blink.flip(2)) - made.synthesise(
            left_like.flip(2), blink.flip(2)
        )
        blink[..., 0] = rig[..., 0].mean(2, keepdim=True)
        walked = made.synthesise(left_like, blink)[0]
    assert torch.allclose(e(False, False), seen.clamp(-1, 1), atol=1e-6)
    assert torch.allclose(
        e(True, False)[:, 0], (seen[:, 1] + moved[0, :, 0]).clamp(-1, 1), atol=1e-6
    )
    assert torch.allclose(e(True, True), walked, atol=1e-6)
    plain = e(False, False)
    made.subject_spread = 0.01 * torch.eye(80)
    off = e(False, False) - plain
    assert off.abs().max() > 0.005 and off.std(0).max() < 1e-6  # the same all through
    made.subject_spread, made.frame_spread = steady, 0.01 * torch.eye(80)
    assert (e(False, False) - plain).std(0).mean() == pytest.approx(0.01, rel=0.2)


def test_widened_model_starts_as_the_audio_model(folder: Path) -> None:
    """With the features that a gaze gives it says nearly what the gaze model said."""
    streams = streams_of(folder, lost=0.0)
    audio_model, _ = load_denoiser(folder / "student", "student")
    fold_gaze(audio_model, inverse=True)
    model = multimodal.widened(audio_model, streams, np.random.default_rng(0))
    batch = streams.draw(4, 50, np.random.default_rng(5))
    tau, noise = torch.full((4,), 200), torch.randn(4, 50, 256)
    with torch.no_grad():
        expected = audio_model(noise, tau, batch.audio, batch.scaled_gaze)
        actual = model(noise, tau, batch.audio, batch.e)
        ahead = audio_model(noise, tau, batch.audio, 0 * batch.scaled_gaze)
    assert (actual - expected).square().mean() < (ahead - expected).square().mean()


def test_halves_take_the_mouth_of_one_and_the_eyes_of_the_other() -> None:
    halves, rng = multimodal.Halves(face()), np.random.default_rng(3)
    one, other = rng.random((2, 1, 5, 53)).astype(np.float32)
    codes = [torch.from_numpy(x @ TO_CODE) for x in (one, other)]
    joined = halves.join(*codes).numpy() @ np.linalg.pinv(TO_CODE)
    mouth = list(SPEECH_COLUMNS)
    upper = [i for i in range(53) if i not in mouth]
    assert np.abs(joined[..., mouth] - one[..., mouth]).max() < 1e-3
    assert np.abs(joined[..., upper] - other[..., upper]).max() < 1e-3


def test_the_mouths_target_is_what_was_heard_and_the_upper_face_the_truth(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another truth of the mouth moves the loss as little as its share says."""
    streams, settings = streams_of(folder, lost=0.0), config(folder, folder)
    audio_model, _ = load_denoiser(folder / "student", "student")
    fold_gaze(audio_model, inverse=True).requires_grad_(False)
    model = multimodal.widened(audio_model, streams, np.random.default_rng(0))
    batch, moved = streams.draw(2, 30, np.random.default_rng(1)), torch.zeros(53)
    moved[list(SPEECH_COLUMNS)] = 0.5
    other = batch._replace(codes=batch.codes + moved @ torch.from_numpy(TO_CODE))
    halves = multimodal.Halves(face())

    def loss(row: eye_streams.Batch, share: float) -> float:
        monkeypatch.setattr(multimodal, "MOUTH_TRUTH", share)
        torch.manual_seed(0)
        return float(
            multimodal.losses(model, audio_model, halves, row, face(), settings)["code"].detach()
        )

    assert loss(other, 0.0) == pytest.approx(loss(batch, 0.0), rel=1e-3)
    assert abs(loss(other, 1.0) - loss(batch, 1.0)) > 0.01


def test_distance_is_of_the_upper_face_alone_and_not_squared(folder: Path) -> None:
    halves, rig = multimodal.Halves(face()), torch.zeros(2, 53)
    rig[0, RIG_INDEX["jawOpen"]] = rig[1, RIG_INDEX["browInnerUp_L"]] = 1.0
    off = (rig @ torch.from_numpy(TO_CODE))[None]
    mouth, brow = multimodal.upper_distance(off, halves, face())[0].tolist()
    assert mouth == pytest.approx(0.01, abs=1e-3)
    assert brow == pytest.approx(float(face().vertices(off[:, 1]).norm(dim=-1).mean()), rel=0.01)
    twice = multimodal.upper_distance(2 * off, halves, face())[0, 1]
    assert float(twice) == pytest.approx(2 * brow, rel=0.01)
    streams, settings = streams_of(folder, lost=0.0), config(folder, folder)
    audio_model, _ = load_denoiser(folder / "student", "student")
    fold_gaze(audio_model, inverse=True).requires_grad_(False)
    model = multimodal.widened(audio_model, streams, np.random.default_rng(0))
    batch = streams.draw(2, 30, np.random.default_rng(1))
    loss = multimodal.losses(model, audio_model, halves, batch, face(), settings)
    parts = loss["code"] + loss["velocity"] + settings.distance_weight * loss["distance"]
    assert float(loss["total"].detach()) == pytest.approx(float(parts.detach()))


def test_loss_falls(folder: Path) -> None:
    torch.manual_seed(0)
    streams = streams_of(folder, lost=0.2)
    audio_model, _ = load_denoiser(folder / "student", "student")
    fold_gaze(audio_model, inverse=True).requires_grad_(False)
    model = multimodal.widened(audio_model, streams, np.random.default_rng(0))
    optimizer = loop.adamw({"model": model}, 3e-3)
    settings, halves = config(folder, folder), multimodal.Halves(face())
    history = []
    for step in range(40):
        batch = streams.draw(4, 30, np.random.default_rng(step))
        loss = multimodal.losses(model, audio_model, halves, batch, face(), settings)
        optimizer.zero_grad()
        loss["total"].backward()
        optimizer.step()
        history.append(float(loss["total"].detach()))
    assert np.mean(history[-5:]) < 0.7 * np.mean(history[:5])
