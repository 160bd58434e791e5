"""Training stages: debug presets run 2 steps and resume to 4, and each loss can reach one batch."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from encoder import checkpoint
from encoder.capture import dataset
from encoder.capture.channels import JAW_OPEN, MOUTH_CLOSE, RIG_NAMES
from encoder.denoiser import PRESETS, Denoiser
from encoder.diffusion import Schedule
from encoder.training import audio, augment, diffusion, distill, loop, streams
from sensors.types import InputError

BASIS = np.linalg.qr(np.random.default_rng(0).standard_normal((256, 53)))[0].T.astype(np.float32)


def rig_to_code(rig: np.ndarray) -> np.ndarray:
    return rig @ BASIS * 10


def vertices(codes: torch.Tensor) -> torch.Tensor:
    return (codes @ torch.tensor(BASIS.T))[..., :30].unflatten(-1, (10, 3))


@pytest.fixture(scope="module")
def pack(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six clips of tones: loud is open."""
    folder, rng, clips = tmp_path_factory.mktemp("pack"), np.random.default_rng(0), []
    for truth in (*audio.HEADS, "rest") * 2:
        level = np.clip(np.sin(np.arange(40) * 0.5 + rng.uniform(0, 6)), 0, 1)
        level = level * (truth != "rest")
        sound = np.repeat(level, 1600) * np.sin(np.arange(40 * 1600) * 0.05) * 0.3
        rig = np.zeros((40, len(RIG_NAMES)))
        rig[:, JAW_OPEN] = 0.4 * level
        gaze = np.tile([0.0, 0.0, 1.0], (40, 2, 1))
        phones = (level > 0.5).astype(int)
        clips.append(dataset.make_clip(sound, rig, gaze, phones, truth=truth, voice="tone"))
    shard = dataset.write_shard(folder / "shard_000.npz", clips)
    dataset.write_manifest(folder, [shard], {"tones": "made by rules"})
    return folder


@pytest.fixture(scope="module")
def stages(pack: Path) -> Path:
    """The folder in which all stages ran their debug preset, each stopped at 2 and resumed to 4."""
    out = pack / "out"
    sound = audio.preset("debug", pack=pack, output=out / "audio", state=out / "audio.state")
    audio.run(sound)
    audio.run(replace(sound, steps=4, resume=True))
    streams.run(
        streams.StreamConfig(
            pack=pack, audio=out / "audio", heads=out / "audio.heads",
            output=out / "streams.npz", minutes=0.2, stream_frames=60,
        )
    )  # fmt: skip
    width = checkpoint.load(out / "audio", "audio")[1]["config"]["feature_dim"] * 4
    teacher = diffusion.preset(
        "debug", streams=out / "streams.npz", output=out / "teacher", state=out / "teacher.state"
    )
    teacher = replace(teacher, denoiser=replace(teacher.denoiser, audio_dim=width))
    diffusion.run(teacher, rig_to_code, vertices)
    diffusion.run(replace(teacher, steps=4, resume=True), rig_to_code, vertices)
    student = distill.preset(
        "debug", streams=out / "streams.npz", teacher=out / "teacher", output=out / "student",
        state=out / "student.state",
    )  # fmt: skip
    distill.run(student, rig_to_code, vertices)
    distill.run(replace(student, steps=4, resume=True), rig_to_code, vertices)
    return out


@pytest.mark.parametrize("kind, name", [("diffusion", "teacher"), ("student", "student")])
def test_stages_write_checkpoints_that_load(stages, kind, name):
    model, card = distill.load_denoiser(stages / name, kind)
    assert card["steps"] == 4 and card["metrics"]["total"] > 0
    noise = torch.randn(1, 5, 256)
    tau = torch.tensor([200])
    x0 = model(noise, tau, torch.zeros(1, 5, model.config.audio_dim), torch.zeros(1, 5, 6))
    assert x0.shape == (1, 5, 256) and x0.isfinite().all()


def test_audio_stage_writes_an_encoder(stages):
    encoder = streams.load_encoder(stages / "audio")
    assert audio.stacked(encoder, torch.zeros(1, 1600)).shape[:2] == (1, 2)


def test_streams_hold_matching_rows(stages):
    data = streams.Streams.load(stages / "streams.npz", rig_to_code)
    codes, sound, gaze, weight = data.draw(3, 12, np.random.default_rng(0))
    assert codes.shape == (3, 12, 256) and gaze.shape == (3, 12, 6) and sound.shape[:2] == (3, 12)
    assert codes.std() > 0 and weight.shape == (3, 12)


def test_folding_the_gaze_changes_no_output():
    torch.manual_seed(0)
    model = Denoiser(PRESETS["debug"])
    torch.nn.init.normal_(model.blocks[0].modulate.weight, std=0.1)
    x, gaze, audio = torch.randn(1, 4, 256), torch.randn(1, 4, 6), torch.randn(1, 4, 512)
    tau, drop = torch.tensor([150]), torch.tensor([False])
    scaled = (gaze - torch.tensor(streams.AHEAD)) * streams.GAZE_SCALE
    keeps = ({}, {"keep_condition": drop})
    before = [model(x, tau, audio, scaled, **keep) for keep in keeps]
    diffusion.fold_gaze(model)
    after = [model(x, tau, audio, gaze, **keep) for keep in keeps]
    torch.testing.assert_close(before, after, atol=1e-5, rtol=1e-4)
    diffusion.fold_gaze(model, inverse=True)
    torch.testing.assert_close(before[0], model(x, tau, audio, scaled), atol=1e-5, rtol=1e-4)


def test_shut_lips_weigh_more():
    rig = np.zeros((1, 3, 53), np.float32)
    rig[0, 1:, JAW_OPEN] = 0.1
    rig[0, 2, MOUTH_CLOSE] = 0.078
    assert streams._shut(rig).tolist() == [[False, False, True]]


def test_resuming_equals_an_unbroken_run(tmp_path):
    def make() -> dict[str, torch.nn.Module]:
        torch.manual_seed(0)
        return {"net": torch.nn.Linear(3, 1)}

    def train(modules: dict[str, torch.nn.Module], steps: int, total: int, resume: bool) -> None:
        optimizer = loop.adamw(modules, 0.1)

        def step_losses(step: int) -> dict[str, torch.Tensor]:
            if step >= steps:
                raise KeyboardInterrupt
            return {"total": modules["net"](torch.randn(4, 3)).square().mean()}

        loop.train(
            "test", modules, optimizer, step_losses, steps=total, rate=0.1,
            state_path=tmp_path / "state", resume=resume,
        )  # fmt: skip

    whole, broken = make(), make()
    train(whole, 6, 6, False)
    with pytest.raises(KeyboardInterrupt):
        train(broken, 3, 6, False)
    resumed = make()
    train(resumed, 6, 6, True)
    torch.testing.assert_close(resumed["net"].state_dict(), whole["net"].state_dict())


def test_resume_without_a_state_says_what_to_do(tmp_path):
    net = {"net": torch.nn.Linear(1, 1)}
    with pytest.raises(InputError, match="without --resume"):
        loop.train(
            "x", net, loop.adamw(net, 0.1), lambda step: {}, steps=1, rate=0.1,
            state_path=tmp_path / "none", resume=True,
        )  # fmt: skip


def test_diffusion_overfits_one_batch(stages):
    torch.manual_seed(0)
    data = streams.Streams.load(stages / "streams.npz", rig_to_code)
    config = diffusion.preset("debug", streams=stages, output=stages, state=stages)
    sizes = replace(PRESETS["debug"], audio_dim=data.features.shape[-1])
    model, schedule = Denoiser(sizes), Schedule()
    diffusion.fit_scale(model, data.codes)
    optimizer = loop.adamw({"model": model}, 3e-3)
    batch = data.draw(4, 16, np.random.default_rng(0))
    config = replace(config, drop=0.0)
    history = []
    for step in range(150):
        torch.manual_seed(step)
        loss = diffusion.losses(model, batch, schedule, vertices, config)
        optimizer.zero_grad()
        loss["total"].backward()
        optimizer.step()
        history.append(float(loss["simple"].detach()))
    assert np.mean(history[-10:]) < 0.35 * np.mean(history[:3])


def test_dmd_gradient_points_to_the_teacher():
    torch.manual_seed(0)
    near, far = torch.full((1, 4, 256), 1.0), torch.zeros(1, 4, 256)

    class Constant(torch.nn.Module):
        def __init__(self, value: torch.Tensor) -> None:
            super().__init__()
            self.value = value

        def forward(self, *_: object) -> torch.Tensor:
            return self.value

    z = torch.zeros(1, 4, 256, requires_grad=True)
    none = torch.zeros(1, 4, 1)
    distill.dmd_loss(Constant(far), Constant(near), z, none, none, Schedule()).backward()
    assert z.grad is not None and (z.grad < 0).all()  # a step down the gradient rises to 1


def test_tau_moves_from_four_steps_to_one():
    rng = np.random.default_rng(0)
    first = {round(distill.draw_tau(0, 200, rng) / 50) for _ in range(100)}
    last = {distill.draw_tau(3, 200, rng) for _ in range(100)}
    assert first == {1, 2, 3, 4}
    assert last <= {199, 200}


def test_distortion_is_causal_enough_and_bounded():
    """A burst may not be heard before it: room and noise start at or after the direct sound."""
    rng = np.random.default_rng(0)
    clean = np.zeros(8000)
    clean[4000:] = 0.5
    for _ in range(20):
        heard = augment.room(clean, rng)
        assert np.abs(heard[:4000]).max() < 1e-9
    assert np.abs(augment.distort(clean, rng)).max() <= 1
