"""Training stages: debug presets run 2 steps and resume to 4, and each loss can reach one batch."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from training_material import FACE, pack_of_tones

from encoder.capture import dataset
from encoder.denoiser.config import PRESETS
from encoder.denoiser.diffusion import Schedule
from encoder.denoiser.model import Denoiser
from encoder.nn import checkpoint
from encoder.training import loop, timesteps
from encoder.training.centred import CentredEncoder
from encoder.training.checkpoints import load_denoiser, load_encoder
from encoder.training.clips import pick, stacked
from encoder.training.stages import audio, diffusion, distill
from encoder.training.streams import streams
from sensors.types import InputError

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def pack(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return pack_of_tones(tmp_path_factory.mktemp("pack"))


def run_twice(stage: Any, config: Any, *rest: Any) -> None:
    """Two steps, then resume to four."""
    stage.run(replace(config, steps=2), *rest)
    stage.run(replace(config, steps=4, run=replace(config.run, resume=True)), *rest)


def settings(out: Path, name: str, **more: Any) -> dict[str, Any]:
    return {"output": out / name, "run": loop.RunSettings(state=out / f"{name}_state"), **more}


@pytest.fixture(scope="module")
def stages(pack: Path) -> Path:
    """The folder in which all stages ran their debug preset."""
    out = pack / "out"
    run_twice(audio, audio.preset("debug", **settings(out, "audio", pack=pack)))
    made = streams.StreamConfig(
        pack=pack, audio=out / "audio", output=out / "streams.npz", minutes=0.2, stream_frames=60
    )
    assert not streams.are_made(made)
    streams.run(made)
    assert streams.are_made(made) and not streams.are_made(replace(made, seed=1))
    motion = {"streams": made.output}
    run_twice(diffusion, diffusion.preset("debug", **settings(out, "teacher", **motion)), FACE)
    regression = settings(out, "regression", objective="regression", **motion)
    run_twice(diffusion, diffusion.preset("debug", **regression), FACE)
    student = settings(out, "student", teacher=out / "teacher", **motion)
    run_twice(distill, distill.preset("debug", **student), FACE)
    return out


@pytest.mark.parametrize(
    "kind, name", [("diffusion", "teacher"), ("student", "student"), ("student", "regression")]
)
def test_stages_write_checkpoints_that_load(stages, kind, name):
    model, card = load_denoiser(stages / name, kind)
    assert card["steps"] == 4 and card["metrics"]["total"] > 0
    assert card["curve"]["step"] == [1, 2, 3, 4] and len(card["curve"]["total"]) == 4
    assert card["audio_sha256"] == checkpoint.load(stages / "audio", "audio")[1]["sha256"]
    noise = torch.randn(1, 5, 256)
    tau = torch.tensor([200])
    x0 = model(noise, tau, torch.zeros(1, 5, model.config.audio_dim), torch.zeros(1, 5, 6))
    assert x0.shape == (1, 5, 256) and x0.isfinite().all()


def test_regression_is_deaf_to_noise(stages):
    tau, gaze = torch.tensor([200]), torch.zeros(1, 5, 6)
    for name, deaf in (("regression", True), ("student", False)):
        model, _ = load_denoiser(stages / name, "student")
        sound = torch.randn(1, 5, model.config.audio_dim)
        a, b = (model(torch.randn(1, 5, 256), tau, sound, gaze) for _ in range(2))
        assert torch.equal(a, b) is deaf


def test_audio_stage_writes_an_encoder(stages):
    encoder = load_encoder(stages / "audio")
    assert stacked(encoder, torch.zeros(1, 1600)).shape[:2] == (1, 2)


def test_an_encoder_can_be_trained_on_but_not_one_of_another_kind(stages, pack, tmp_path):
    go_on = audio.preset("debug", **settings(tmp_path, "audio", pack=pack))
    go_on = replace(go_on, start=stages / "audio", rate=0.0)
    audio.run(go_on)
    before, after = (load_encoder(p / "audio") for p in (stages, tmp_path))
    torch.testing.assert_close(before.project.weight, after.project.weight, atol=1e-3, rtol=1e-3)
    first, then = (json.loads((p / "audio.json").read_text()) for p in (stages, tmp_path))
    assert then["start"] == [{"sha256": first["sha256"], "steps": first["steps"]}]
    with pytest.raises(InputError, match="--start"):
        audio.run(replace(go_on, centred=True))


def test_the_centred_encoder_is_another_kind(pack, tmp_path):
    out = tmp_path
    config = audio.preset("debug", **settings(out, "audio", pack=pack))
    audio.run(replace(config, centred=True, steps=1))
    assert isinstance(load_encoder(out / "audio"), CentredEncoder)
    with pytest.raises(InputError, match="kind 'audio'"):
        checkpoint.load(out / "audio", "audio")


@pytest.mark.parametrize(("truth", "share"), [("tracked", 0.25), ("rules", 0.1)])
def test_few_tracked_voices_are_heard_more_often(pack, truth, share):
    clip = next(dataset.iter_pack(pack))
    clips = [replace(clip, voice="a")] * 90 + [replace(clip, voice="b")] * 10
    rng = np.random.default_rng(0)
    drawn = [pick(clips, truth, rng).voice for _ in range(800)]
    assert np.mean([voice == "b" for voice in drawn]) == pytest.approx(share, abs=0.05)


def test_streams_hold_matching_rows(stages):
    data = streams.Streams.load(stages / "streams.npz", FACE)
    codes, sound, gaze, weight = data.draw(3, 12, np.random.default_rng(0))
    assert codes.shape == (3, 12, 256) and gaze.shape == (3, 12, 6) and sound.shape[:2] == (3, 12)
    assert codes.std() > 0 and weight.shape == (3, 12)
    now = np.arange(data.codes.shape[1], dtype=np.float32)[:, None]
    counting = replace(data, features=np.stack([now] * len(data.codes)))
    counting = replace(counting, codes=counting.features)
    drawn, heard, _, _ = counting.draw(2, 10, np.random.default_rng(0), ahead=5)
    assert torch.equal(heard, drawn + 5)


def test_a_talker_who_is_left_out_is_in_no_window(stages):
    data = streams.Streams.load(stages / "streams.npz", FACE, without=("tone",))
    assert data.barred is not None and 0 < data.barred.mean() < 1
    counting = replace(data, weight=data.barred.astype(np.float32))
    for seed in range(20):
        assert not counting.draw(3, 4, np.random.default_rng(seed))[3].any()
    nobody = replace(data, barred=np.ones_like(data.barred))  # red before: it never ended
    with pytest.raises(InputError, match="--leave-out: expected .* leave fewer out"):
        nobody.draw(3, 4, np.random.default_rng(0))
    with pytest.raises(InputError, match="--leave-out: expected one of tone"):
        streams.Streams.load(stages / "streams.npz", FACE, without=("nobody",))


def test_diffusion_overfits_one_batch(stages):
    torch.manual_seed(0)
    data = streams.Streams.load(stages / "streams.npz", FACE)
    config = diffusion.preset(
        "debug",
        streams=stages,
        output=stages,
        run=loop.RunSettings(state=stages / "none"),
        drop=0.0,
        last_share=0.25,
    )
    sizes = replace(PRESETS["debug"], audio_dim=data.features.shape[-1])
    model, schedule = Denoiser(sizes), Schedule()
    diffusion.fit_scale(model, data.codes)
    optimizer = loop.adamw({"model": model}, 3e-3)
    batch = data.draw(4, 16, np.random.default_rng(0))
    history = []
    for step in range(150):
        torch.manual_seed(step)
        loss = diffusion.losses(model, batch, schedule, FACE, config)
        optimizer.zero_grad()
        loss["total"].backward()
        optimizer.step()
        history.append(float(loss["simple"].detach()))
    assert np.mean(history[-10:]) < 0.35 * np.mean(history[:3])


@pytest.mark.parametrize("part, eyes_move", [("mouth", False), ("face", True)])
def test_the_geometry_of_the_mouth_leaves_the_lids_alone(part, eyes_move, tmp_path):
    """A mean of blinks is none: what the truth's lids do is the teacher's to say."""
    student, generator = Denoiser(PRESETS["debug"]), torch.Generator().manual_seed(0)
    codes, noise = torch.randn(2, 1, 8, 256, generator=generator)
    sound, gaze = torch.zeros(1, 8, student.config.audio_dim), torch.zeros(1, 8, 6)
    paths = {"streams": tmp_path, "teacher": tmp_path}
    config = distill.preset("debug", **settings(tmp_path, "student", **paths))
    config = replace(config, geometry_of=part, truth_weight=0.0, dmd_weight=0.0)
    sample = (noise, 200, codes, sound, gaze, torch.ones(1, 8), torch.zeros_like(codes))
    shown = torch.zeros_like(codes, requires_grad=True)
    student.forward = lambda *_: shown  # type: ignore[method-assign]
    parts = distill.losses(student, student, sample, Schedule(), FACE, config)
    (parts["total"] - parts["distill"]).backward()
    assert shown.grad is not None and shown.grad[..., :128].abs().max() > 0
    assert bool(shown.grad[..., 128:].abs().max() > 0) is eyes_move


def test_dmd_ends_where_the_student_is_trained_at_tau_n_alone(stages, tmp_path, monkeypatch):
    monkeypatch.setattr(distill, "phase_at", lambda *_: 4)
    motion = {"streams": stages / "streams.npz", "teacher": stages / "teacher"}
    for end, kept in ((False, False), (True, True)):
        config = distill.preset("debug", **settings(tmp_path, "student", **motion))
        metrics = distill.run(replace(config, dmd_to_end=end), FACE)
        assert ("dmd" in metrics) is kept


def test_tau_moves_from_four_steps_to_one_in_four_updates():
    rng = np.random.default_rng(0)
    first = {round(timesteps.draw_tau(0, 200, rng) / 50) for _ in range(100)}
    last = {timesteps.draw_tau(4, 200, rng) for _ in range(100)}
    assert first == {1, 2, 3, 4}
    assert last <= {199, 200}
    assert all(timesteps.beta(phase).sum() == pytest.approx(1) for phase in range(5))
    config = distill.preset(
        "paper", streams=Path(), teacher=Path(), output=Path(), run=loop.RunSettings(state=Path())
    )
    assert [distill.phase_at(step, config) for step in (0, 1999, 2000, 7999, 8000, 24_999)] == [
        0, 0, 1, 3, 4, 4,
    ]  # fmt: skip


def test_some_streams_are_heard_by_a_good_microphone(pack, monkeypatch):
    distortions, crop = set[float](), streams.crop

    def watched(clip, frames, rng, p):
        distortions.add(p)
        return crop(clip, frames, rng, p)

    monkeypatch.setattr(streams, "crop", watched)
    groups = {"rules": streams.grouped(pack, "train")["rules"]}
    config = streams.StreamConfig(
        pack=pack, audio=pack, output=pack, stream_frames=30, clean_streams=0.5
    )
    for seed in range(12):
        streams.draw_stream(groups, config, np.random.default_rng(seed))
    assert distortions == {0.0, 0.3}
