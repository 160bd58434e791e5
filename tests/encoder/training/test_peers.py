"""Twins of the baselines: shapes, chance, the future they hear, training and their files."""

from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
import torch
from training_material import FACE

from encoder.capture.motion.channels import JAW_OPEN
from encoder.training import loop
from encoder.training.peers import diffposetalk
from encoder.training.peers.kinds import KINDS, load_peer, make_peer
from encoder.training.peers.parts import PeerName, PeerNetwork
from encoder.training.stages import peers
from encoder.training.streams.streams import Streams
from sensors.types import InputError

AUDIO = 12
NAMES = get_args(PeerName)


def twin(name: PeerName, seed: int = 0) -> PeerNetwork:
    torch.manual_seed(seed)
    sizes = replace(peers.sized(name, "debug"), audio_dim=AUDIO, lips=30)
    return make_peer(sizes).eval()


def sound(frames: int, seed: int = 1) -> torch.Tensor:
    return torch.randn(2, frames, AUDIO, generator=torch.Generator().manual_seed(seed))


def chance(frames: int, seed: int = 2) -> torch.Tensor:
    return torch.randn(2, frames, 256, generator=torch.Generator().manual_seed(seed))


def test_every_name_has_a_network():
    assert set(KINDS) == set(NAMES)


@torch.no_grad()
@pytest.mark.parametrize("name", NAMES)
def test_what_a_twin_shows_depends_on_its_noise_alone(name):
    peer = twin(name)
    shown, again = (peer.codes(sound(14), chance(14)) for _ in range(2))
    other = peer.codes(sound(14), chance(14, seed=3))
    assert shown.shape == (2, 14, 256) and shown.isfinite().all()
    assert torch.equal(shown, again)
    assert torch.equal(shown, other) is not peer.draws


@torch.no_grad()
@pytest.mark.parametrize("name", NAMES)
def test_none_is_causal(name):
    """Sound after a frame changes the frame, and NaN there spoils it."""
    peer, heard = twin(name), sound(14)
    broken = heard.clone()
    broken[:, 10:] = torch.nan
    assert peer.codes(heard, chance(14)).isfinite().all()
    assert peer.codes(broken, chance(14))[:, :8].isnan().any()


@torch.no_grad()
def test_windows_begin_where_one_ended(monkeypatch):
    monkeypatch.setattr(diffposetalk, "WINDOW", 16)
    peer, heard, noise = twin("diffposetalk"), sound(40), chance(40)
    shown = peer.codes(heard, noise)
    assert shown.shape == (2, 40, 256)
    noise[:, :16] += 1
    moved = (peer.codes(heard, noise) - shown).abs().amax((0, 2))
    assert (moved[16:] > 0).all()


@torch.no_grad()
def test_style_comes_from_the_truth_where_it_is_given():
    peer, truth = twin("diffposetalk"), chance(14, seed=5)
    plain = peer.codes(sound(14), chance(14))
    styled = peer.codes(sound(14), chance(14), truth)
    assert not torch.equal(plain, styled)
    for name in ("talkshow", "audio2photoreal"):
        other = twin(name)
        assert torch.equal(
            other.codes(sound(14), chance(14)), other.codes(sound(14), chance(14), truth)
        )


def test_pieces_of_one_clip_are_alike():
    styles = torch.eye(4, 8)
    alike = diffposetalk.contrast(styles, styles)
    assert alike < 0.1 < diffposetalk.contrast(styles, styles.roll(1, 0))


def made_streams(folder: Path) -> Path:
    """Two streams in which loud is open, as `streams.run` writes them."""
    rng = np.random.default_rng(0)
    level = np.clip(np.sin(np.arange(60) * 0.5), 0, 1)
    rig = np.zeros((2, 60, 53), np.float16)
    rig[..., JAW_OPEN] = 0.4 * level
    features = rng.standard_normal((2, 60, AUDIO)) + level[:, None]
    gaze = np.tile(np.array([0, 0, 1, 0, 0, 1], np.float16), (2, 60, 1))
    about = '{"sources": {"tones": "made by rules"}, "audio_sha256": "none", "voices": [""]}'
    np.savez(
        folder / "streams.npz", features=features.astype(np.float16), rig=rig, gaze=gaze,
        voices=np.zeros((2, 60), np.int16), about=np.array(about),
    )  # fmt: skip
    return folder / "streams.npz"


def config_of(name: PeerName, folder: Path, streams: Path) -> peers.PeersConfig:
    return peers.preset(
        "debug",
        streams=streams,
        output=folder / name,
        run=loop.RunSettings(state=folder / f"{name}_state"),
        peer=peers.sized(name, "debug"),
        frames=24,
    )


@pytest.mark.parametrize("name", NAMES)
def test_training_resumes_where_it_stopped_and_writes_a_card(name, tmp_path):
    streams = made_streams(tmp_path)
    config = config_of(name, tmp_path / "peers", streams)
    peers.run(replace(config, steps=2), FACE)
    peers.run(replace(config, steps=4, run=replace(config.run, resume=True)), FACE)
    peer, card = load_peer(tmp_path / "peers" / name)
    assert card["budget"] == {"steps": 4, "batch": 2, "frames": 24}
    assert card["parameters"] == sum(p.numel() for p in peer.parameters())
    assert card["config"]["audio_dim"] == AUDIO and card["config"]["name"] == name
    assert card["curve"]["step"] == [1, 2, 3, 4]
    shown = peer.codes(sound(9), chance(9))
    assert shown.shape == (2, 9, 256) and shown.isfinite().all()
    with pytest.raises(InputError, match="train peers"):
        load_peer(tmp_path / "nothing")
    with pytest.raises(InputError, match="--preset debug, default, got paper"):
        peers.sized(name, "paper")


@torch.no_grad()
@pytest.mark.parametrize("name", NAMES)
def test_windows_of_the_debug_preset_have_losses(name, tmp_path):
    """Red before: after diffposetalk's past too little was left for a second difference: nan."""
    frames = peers.preset.named["debug"]["frames"]
    streams, peer = Streams.load(made_streams(tmp_path), FACE), twin(name)
    for seed in range(6):  # half of the windows come after another
        torch.manual_seed(seed)
        batch = streams.draw(2, frames, np.random.default_rng(seed))
        assert peer.losses(batch, FACE)["total"].isfinite()


@pytest.mark.parametrize("name", NAMES)
def test_a_twin_learns_one_batch(name, tmp_path):
    streams = Streams.load(made_streams(tmp_path), FACE)
    batch, peer = streams.draw(4, 24, np.random.default_rng(0)), twin(name).train()
    optimizer = loop.adamw({"peer": peer}, 1e-2)
    history = []
    for step in range(50):
        torch.manual_seed(step)
        losses = peer.losses(batch, FACE)
        optimizer.zero_grad()
        losses["total"].backward()
        optimizer.step()
        history.append(float(losses["simple"].detach()))
    assert np.mean(history[-10:]) < 0.75 * np.mean(history[:3])
