"""Stage 2: train the diffusion model, the teacher E_orig (paper section 4.1).

L = L_simple + lambda_vel L_vel + lambda_jitter L_jitter. Audio and gaze are dropped at random so
that guidance has an unconditional model. Also trains the offline teacher (full attention) and the
regression baseline of table 3, the same network without noise.

Clips have 100 frames but a live stream has no end: clips start anywhere in streams of half a
minute, positions are relative (RoPE), and a frame depends on at most layers x window = 100 past
ones.
"""

from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from torch import Tensor

from encoder.denoiser.config import PRESETS as DENOISERS
from encoder.denoiser.config import DenoiserConfig
from encoder.denoiser.diffusion import Schedule
from encoder.denoiser.model import Denoiser, headless
from encoder.nn import checkpoint
from encoder.training import loop, parallel
from encoder.training.checkpoints import load_denoiser
from encoder.training.geometry import (
    TrainingFace,
    contact_loss,
    jitter_loss,
    spread_loss,
    velocity_loss,
)
from encoder.training.peers.parts import PeerNetwork
from encoder.training.presets import Presets
from encoder.training.streams.streams import AHEAD, GAZE_SCALE, Streams
from encoder.training.streams.whitening import Whitening
from sensors.types import InputError

TRUTH = (
    "mouth: made by rules from phones, by a face tracker (GRID; closures and tucks by rules) "
    "or a solved capture (FACEGOOD); eyes, lids and brows: made by rules"
)


@dataclass(frozen=True, kw_only=True)
class DiffusionConfig:
    streams: Path
    output: Path
    run: loop.RunSettings
    start: Path | None = None  # a checkpoint of the same config to go on from
    objective: Literal["diffusion", "regression"] = "diffusion"
    denoiser: DenoiserConfig = field(default_factory=lambda: DENOISERS["default"])
    steps: int = 6000
    batch: int = 16
    frames: int = 100
    rate: float = 1e-3
    drop: float = 0.2  # classifier-free guidance dropout of each condition
    last_share: float = 0.6  # share of draws at tau = N, where the student works
    # per mm^2 a frame^2. Not more: who may not move fast cannot correct, frame by frame, what was
    # guessed before the sound was known
    velocity_weight: float = 0.1
    jitter_weight: float = 0.02
    jitter_normalised: bool = True
    spread_weight: float = 0.0  # per mm^2; only where one step must do, at tau = N
    contact_weight: float = 4.0
    lookahead: int = 0  # frames of future sound: a ceiling to compare with, not for live use
    without: tuple[str, ...] = ()  # talkers whose tracked motion is left out


preset = Presets(
    DiffusionConfig,
    {
        "debug": {"denoiser": DENOISERS["debug"], "steps": 2, "batch": 2, "frames": 12},
        "default": {},
        "paper": {
            "denoiser": DENOISERS["paper"],
            "steps": 250_000,
            "batch": 256,
            "rate": 1e-4,
            "last_share": 0.0,
            "velocity_weight": 1.0,
            "contact_weight": 0.0,
        },
    },
)


def weighted_error(predicted: Tensor, truth: Tensor, weight: Tensor) -> Tensor:
    """Mean squared error of [B, T, C], weighted by frame [B, T]."""
    return ((predicted - truth).square().mean(-1) * weight).mean()


def fit_scale(model: Denoiser | PeerNetwork, codes: np.ndarray) -> None:
    """Fit mean and spread to the training codes; a constant code gets a small spread, not zero."""
    flat = codes.reshape(-1, codes.shape[-1]).astype(np.float64)
    std = flat.std(0)
    model.expression_mean.copy_(torch.tensor(flat.mean(0)))
    model.expression_std.copy_(torch.tensor(np.maximum(std, 0.02 * std.max() + 1e-6)))


@torch.no_grad()
def fold_gaze(model: Denoiser, *, inverse: bool = False) -> Denoiser:
    """In place: turn a model trained on (gaze - ahead) * scale into one for plain gaze."""
    weight, bias, null = model.input.weight, model.input.bias, model.null_condition
    ahead, columns = torch.tensor(AHEAD, device=weight.device), slice(-len(AHEAD), None)
    if inverse:
        bias += weight[:, columns] @ ahead
        weight[:, columns] /= GAZE_SCALE
        null.copy_((null - ahead) * GAZE_SCALE)
    else:
        weight[:, columns] *= GAZE_SCALE
        bias -= weight[:, columns] @ ahead
        null.copy_(null / GAZE_SCALE + ahead)
    return model


def draw_tau(count: int, num_steps: int, last_share: float, device: torch.device) -> Tensor:
    """[B] int64: uniform over 1..N, with an extra share at N."""
    tau = torch.randint(1, num_steps + 1, (count,), device=device)
    last = torch.rand(count, device=device) < last_share
    return torch.where(last, torch.full_like(tau, num_steps), tau)


def geometry_losses(
    predicted: Tensor, codes: Tensor, face: TrainingFace, config: Any
) -> tuple[dict[str, Tensor], Tensor]:
    """Terms of L_geom for codes [B, T, 256], and their sum with the weights of the config."""
    guess, truth = face.vertices(predicted), face.vertices(codes)
    parts = {"velocity": velocity_loss(guess, truth, face.weights)}
    total = config.velocity_weight * parts["velocity"]
    if config.jitter_weight:
        parts["jitter"] = jitter_loss(
            guess, truth, face.weights, normalised=config.jitter_normalised
        )
        total = total + config.jitter_weight * parts["jitter"]
    if config.spread_weight:
        parts["spread"] = spread_loss(guess, truth, face.weights)
        total = total + config.spread_weight * parts["spread"]
    if config.contact_weight:
        parts["contact"] = contact_loss(face.gaps(predicted), face.gaps(codes))
        total = total + config.contact_weight * parts["contact"]
    return parts, total


def losses(
    model: Denoiser,
    batch: tuple[Tensor, ...],  # codes, audio, gaze, weight
    schedule: Schedule,
    face: TrainingFace,
    config: DiffusionConfig,
) -> dict[str, Tensor]:
    codes, audio, gaze, weight = batch
    x0 = model.standardise(codes)
    if config.objective == "regression":
        tau = torch.full((len(x0),), schedule.num_steps, device=x0.device)
        predicted = model(torch.zeros_like(x0), tau, audio, gaze)
    else:
        tau = draw_tau(len(x0), schedule.num_steps, config.last_share, x0.device)
        noisy = schedule.q_sample(x0, tau, torch.randn_like(x0))
        keep = [torch.rand(len(x0), device=x0.device) >= config.drop for _ in range(2)]
        predicted = model(noisy, tau, audio, gaze, keep_audio=keep[0], keep_condition=keep[1])
    simple = weighted_error(predicted, x0, weight)
    parts, geometry = geometry_losses(model.unstandardise(predicted), codes, face, config)
    return {"simple": simple, **parts, "total": simple + geometry}


def run(config: DiffusionConfig, face: TrainingFace) -> dict[str, float]:
    """Train and write the model with its card; returns the smoothed losses."""
    ranks = parallel.join(config.run.device)
    torch.manual_seed(config.run.seed)
    streams = Streams.load(config.streams, face, config.without)
    sizes = replace(config.denoiser, audio_dim=streams.features.shape[-1])
    model, schedule = Denoiser(sizes), Schedule(sizes.num_steps)
    fit_scale(model, streams.codes[streams.allowed])
    whitening = Whitening.of(streams.features[streams.allowed])
    if config.start is not None:
        old = headless(load_denoiser(config.start, "diffusion", "student")[0])
        if old.config != sizes:
            raise InputError(
                f"--start {config.start}: expected a model of the same config, got another; "
                "leave --start away or choose its preset"
            )
        whitening.fold(fold_gaze(old, inverse=True), inverse=True)
        model.load_state_dict(old.state_dict())  # with its scale
    model.to(config.run.device)
    whitening = whitening.to(config.run.device)
    forward = torch.compile(losses) if config.run.compile else losses

    def step_losses(step: int, rng: np.random.Generator) -> dict[str, Tensor]:
        drawn = streams.draw(config.batch, config.frames, rng, config.lookahead)
        device = config.run.device
        codes, audio, gaze, weight = (t.to(device, non_blocking=True) for t in drawn)
        batch = codes, whitening(audio), gaze, weight
        return forward(model, batch, schedule, face, config)

    metrics, curve = loop.train(
        config.objective, {"denoiser": model}, step_losses,
        steps=config.steps, rate=config.rate, run=config.run,
    )  # fmt: skip
    if ranks.leads:
        fold_gaze(whitening.fold(model))
        write(config, model, streams, config.run.card(metrics, curve))
    parallel.wait(ranks)
    return metrics


def write(
    config: DiffusionConfig, model: Denoiser, streams: Streams, trained: dict[str, Any]
) -> None:
    """Write the model; the regression baseline as a student that ignores noise, so that it runs
    live."""
    regression = config.objective == "regression"
    if regression:
        with torch.no_grad():
            model.input.weight[:, : model.config.expression_dim] = 0
    card = {
        "kind": "student" if regression else "diffusion",
        "config": asdict(model.config),
        "data": streams.about["sources"],
        "audio_sha256": streams.about["audio_sha256"],
        "truth": TRUTH,
        "objective": config.objective,
        "velocity_weight": config.velocity_weight,
        "jitter_weight": config.jitter_weight,
        "jitter_normalised": config.jitter_normalised,
        "contact_weight": config.contact_weight,
        "lookahead": config.lookahead,
        "without": config.without,
        "steps": config.steps,
        **trained,
    }
    checkpoint.save(config.output, model.state_dict(), card)
