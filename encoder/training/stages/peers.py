"""Stage "peers": train a twin of one of the paper's baselines (table 1) on the streams we train on.

One budget for all: the steps, batch, windows and rate of this config, and AdamW with a cosine, as
in `diffusion`. What comes out is for `eval speech --peers`; it is not shipped.
"""

from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from encoder.nn import checkpoint
from encoder.training import loop
from encoder.training.geometry import TrainingFace
from encoder.training.peers.kinds import make_peer
from encoder.training.peers.parts import PeerConfig, PeerName, WholeClipEars
from encoder.training.presets import Presets
from encoder.training.stages.diffusion import TRUTH, fit_scale
from encoder.training.streams.streams import Streams
from encoder.training.streams.whitening import Whitening
from sensors.types import InputError


@dataclass(frozen=True, kw_only=True)
class PeersConfig:
    streams: Path
    output: Path
    run: loop.RunSettings
    peer: PeerConfig
    steps: int = 1000
    batch: int = 16
    frames: int = 100
    rate: float = 1e-3


preset = Presets(PeersConfig, {"debug": {"steps": 2, "batch": 2, "frames": 24}, "default": {}})
SIZES: dict[str, dict[str, int]] = {
    "debug": {"dim": 16, "ff_dim": 32, "heads": 2, "ears": 1, "layers": 2, "num_steps": 20},
    "default": {},
}


def sized(name: PeerName, preset: str) -> PeerConfig:
    """The twin's sizes in a preset."""
    if preset not in SIZES:
        known = ", ".join(SIZES)
        raise InputError(f"train peers: expected --preset {known}, got {preset}; choose one")
    return PeerConfig(**{"name": name, **SIZES[preset]})


def run(config: PeersConfig, face: TrainingFace) -> dict[str, float]:
    """Train and write the twin with its card; returns the smoothed losses."""
    torch.manual_seed(config.run.seed)
    streams = Streams.load(config.streams, face)
    lips = 3 * int((face.weights == face.weights.max()).sum())
    sizes = replace(config.peer, audio_dim=streams.features.shape[-1], lips=lips)
    peer = make_peer(sizes)
    fit_scale(peer, streams.codes)
    whitening = Whitening.of(streams.features)
    for module in peer.modules():
        if isinstance(module, WholeClipEars):
            module.whiten(whitening)
    peer.to(config.run.device)

    def step_losses(step: int, rng: np.random.Generator) -> dict[str, Tensor]:
        drawn = streams.draw(config.batch, config.frames, rng)
        return peer.losses(tuple(part.to(config.run.device) for part in drawn), face)

    metrics, curve = loop.train(
        sizes.name, {"peer": peer}, step_losses,
        steps=config.steps, rate=config.rate, run=config.run,
    )  # fmt: skip
    card = {
        "kind": "peer",
        "config": asdict(sizes),
        "parameters": sum(p.numel() for p in peer.parameters()),
        "budget": {"steps": config.steps, "batch": config.batch, "frames": config.frames},
        "data": streams.about["sources"],
        "audio_sha256": streams.about["audio_sha256"],
        "truth": TRUTH,
        **config.run.card(metrics, curve),
    }
    checkpoint.save(config.output, peer.state_dict(), card)
    return metrics
