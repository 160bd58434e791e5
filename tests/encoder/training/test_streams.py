"""Sound as microphones hear it, eyes as cameras lose them, scales that fold into a model."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from encoder.capture.speech.handling import HANDLING
from encoder.denoiser.config import PRESETS
from encoder.denoiser.model import Denoiser
from encoder.eyes.tracker import FADE_FRAMES, HOLD_FRAMES
from encoder.training.stages import diffusion
from encoder.training.streams import augment, streams
from encoder.training.streams import eyes as eye_streams
from encoder.training.streams.whitening import Whitening
from sensors.types import InputError

pytestmark = pytest.mark.slow


def test_streams_of_no_encoder_name_the_stage_that_makes_one(tmp_path: Path) -> None:
    """Red before: expected a file or folder audio.json, got none; check the path."""
    config = streams.StreamConfig(
        pack=tmp_path, audio=tmp_path / "audio", output=tmp_path / "s.npz"
    )
    with pytest.raises(InputError, match="run `livedrive train audio`"):
        streams.made_from(config)


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


def test_whitening_makes_features_alike_and_folds_away():
    torch.manual_seed(0)
    features = torch.randn(3, 400, 16) @ torch.randn(16, 16) * torch.logspace(0, -1, 16) + 5
    whitening = Whitening.of(features.numpy())
    white = whitening(features).flatten(0, 1)
    torch.testing.assert_close(white.mean(0), torch.zeros(16), atol=1e-3, rtol=0)
    assert torch.cov(white.T).sub(torch.eye(16)).abs().max() < 0.6
    assert torch.cov(white.T).diagonal().max() < 1.01

    model = Denoiser(replace(PRESETS["debug"], audio_dim=16))
    torch.nn.init.normal_(model.null_audio)
    x, gaze, tau = torch.randn(3, 400, 256), torch.randn(3, 400, 6), torch.tensor([150])
    keeps = ({}, {"keep_audio": torch.tensor([False] * 3)})
    before = [model(x, tau, whitening(features), gaze, **keep) for keep in keeps]
    whitening.fold(model)
    after = [model(x, tau, features, gaze, **keep) for keep in keeps]
    torch.testing.assert_close(before, after, atol=1e-4, rtol=1e-3)
    whitening.fold(model, inverse=True)
    again = model(x, tau, whitening(features), gaze)
    torch.testing.assert_close(before[0], again, atol=1e-4, rtol=1e-3)


def test_distortion_is_causal_enough_and_bounded():
    """A burst may not be heard before it: room and noise start at or after the direct sound."""
    rng = np.random.default_rng(0)
    clean = np.zeros(8000)
    clean[4000:] = 0.5
    for _ in range(20):
        heard = augment.room(clean, rng)
        assert np.abs(heard[:4000]).max() < 1e-9
    assert np.abs(augment.distort(clean, rng)).max() <= 1


@pytest.mark.parametrize("make", [augment.noise, augment.music, augment.clicks, *HANDLING[1:]])
def test_sounds_that_are_no_speech_have_unit_level(make):
    sound = make(24_000, np.random.default_rng(0))
    assert sound.shape == (24_000,) and sound.std() == pytest.approx(1)


def test_not_speech_is_bounded_and_sometimes_silent():
    sounds = [augment.not_speech(4800, np.random.default_rng(k)) for k in range(30)]
    assert max(float(np.abs(x).max()) for x in sounds) <= 1
    assert any(not x.any() for x in sounds) and any(x.any() for x in sounds)


def test_eyes_are_lost_as_often_as_asked() -> None:
    rng = np.random.default_rng(0)
    share = [
        float(eye_streams._lost_frames(100, c, rng).any()) for c in (0.0, 0.5) for _ in range(200)
    ]
    assert np.mean(share[:200]) == 0 and 0.3 < np.mean(share[200:]) < 0.6


def test_lost_eyes_hold_then_fade_to_the_other() -> None:
    own = torch.arange(60.0)[:, None].repeat(1, 80)
    other, gone = own + 1000, torch.zeros(60, dtype=torch.bool)
    gone[20:45] = True
    row = eye_streams._switched(own, other, gone)[:, 0]
    assert torch.equal(row[:20], own[:20, 0])
    assert (row[20 : 20 + HOLD_FRAMES] == 19).all()
    settled = 20 + HOLD_FRAMES + FADE_FRAMES - 1
    assert torch.equal(row[settled:45], other[settled:45, 0])
    assert torch.equal(row[45 + FADE_FRAMES - 1 :], own[45 + FADE_FRAMES - 1 :, 0])
    assert row.diff().abs().max() < 1000 / FADE_FRAMES + 10
    every = eye_streams._switched(own, other, torch.ones(60, dtype=torch.bool))
    assert torch.equal(every, other)
