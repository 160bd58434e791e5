"""Stage 2: train the diffusion model, the teacher E_orig (paper section 4.1).

L = L_simple + lambda * L_vel: squared error of x0 in standardised code space, and of the velocity
of face vertices. Audio and gaze are dropped at random so that guidance has an unconditional model.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from encoder import checkpoint
from encoder.denoiser import PRESETS as DENOISERS
from encoder.denoiser import Denoiser, DenoiserConfig
from encoder.diffusion import Schedule
from encoder.training import loop
from encoder.training.streams import AHEAD, GAZE_SCALE, Streams

TRUTH = (
    "mouth: made by rules from phones, by a face tracker (GRID), or by rule-trained audio heads "
    "and loudness (other real voices); eyes, lids and brows: made by rules"
)
RigToCode = Callable[[np.ndarray], np.ndarray]  # [..., 53] -> [..., 256]
Vertices = Callable[[Tensor], Tensor]  # codes [B, T, 256] -> face vertices [B, T, V, 3] mm


@dataclass(frozen=True, kw_only=True)
class DiffusionConfig:
    streams: Path
    output: Path
    state: Path
    denoiser: DenoiserConfig = field(default_factory=lambda: DENOISERS["default"])
    steps: int = 1750
    batch: int = 16
    frames: int = 80
    rate: float = 1e-3
    drop: float = 0.2  # classifier-free guidance dropout of each condition
    velocity_weight: float = 1.0  # per mm^2 of vertex velocity error
    seed: int = 0
    resume: bool = False
    note: tuple[tuple[str, str], ...] = ()


PRESETS: dict[str, dict[str, Any]] = {
    "debug": {"denoiser": DENOISERS["debug"], "steps": 2, "batch": 2, "frames": 12},
    "default": {},
    "paper": {
        "denoiser": DENOISERS["paper"],
        "steps": 250_000,
        "batch": 256,
        "frames": 100,
        "rate": 1e-4,
    },
}


def velocity_loss(predicted: Tensor, truth: Tensor) -> Tensor:
    """Vertices [B, T, V, 3] mm -> mean squared error of the frame-to-frame motion, mm^2."""
    return (predicted - truth).diff(dim=1).square().sum(-1).mean()


def weighted_error(predicted: Tensor, truth: Tensor, weight: Tensor) -> Tensor:
    """Mean squared error of [B, T, C] with a weight a frame [B, T]."""
    return ((predicted - truth).square().mean(-1) * weight).mean()


def fit_scale(model: Denoiser, codes: np.ndarray) -> None:
    """Standardise by the training codes; a constant code keeps a small spread instead of none."""
    flat = codes.reshape(-1, codes.shape[-1]).astype(np.float64)
    std = flat.std(0)
    model.expression_mean.copy_(torch.tensor(flat.mean(0)))
    model.expression_std.copy_(torch.tensor(np.maximum(std, 0.02 * std.max() + 1e-6)))


@torch.no_grad()
def fold_gaze(model: Denoiser, *, inverse: bool = False) -> Denoiser:
    """In place: from a model of (gaze - ahead) * scale, as trained, to one of plain gaze."""
    ahead, columns = torch.tensor(AHEAD), slice(-len(AHEAD), None)
    weight, bias, null = model.input.weight, model.input.bias, model.null_condition
    if inverse:
        bias += weight[:, columns] @ ahead
        weight[:, columns] /= GAZE_SCALE
        null.copy_((null - ahead) * GAZE_SCALE)
    else:
        weight[:, columns] *= GAZE_SCALE
        bias -= weight[:, columns] @ ahead
        null.copy_(null / GAZE_SCALE + ahead)
    return model


def losses(
    model: Denoiser,
    batch: tuple[Tensor, ...],  # codes, audio, gaze, weight
    schedule: Schedule,
    vertices: Vertices,
    config: DiffusionConfig,
) -> dict[str, Tensor]:
    codes, audio, gaze, weight = batch
    x0 = model.standardise(codes)
    # half of the draws at high noise: the student will live at tau = N
    tau = torch.randint(1, schedule.num_steps + 1, (len(x0),))
    tau = torch.where(torch.rand(len(x0)) < 0.25, torch.full_like(tau, schedule.num_steps), tau)
    noisy = schedule.q_sample(x0, tau, torch.randn_like(x0))
    keep = [torch.rand(len(x0)) >= config.drop for _ in range(2)]
    predicted = model(noisy, tau, audio, gaze, keep_audio=keep[0], keep_condition=keep[1])
    simple = weighted_error(predicted, x0, weight)
    velocity = velocity_loss(vertices(model.unstandardise(predicted)), vertices(codes))
    return {
        "simple": simple,
        "velocity": velocity,
        "total": simple + config.velocity_weight * velocity,
    }


def run(config: DiffusionConfig, rig_to_code: RigToCode, vertices: Vertices) -> dict[str, float]:
    """Train and write the teacher with its card; returns the smoothed losses."""
    torch.manual_seed(config.seed)
    streams = Streams.load(config.streams, rig_to_code)
    model, schedule = Denoiser(config.denoiser), Schedule(config.denoiser.num_steps)
    fit_scale(model, streams.codes)

    def step_losses(step: int) -> dict[str, Tensor]:
        batch = streams.draw(
            config.batch, config.frames, np.random.default_rng([config.seed, step])
        )
        return losses(model, batch, schedule, vertices, config)

    modules = {"denoiser": model}
    metrics = loop.train(
        "diffusion", modules, loop.adamw(modules, config.rate), step_losses, steps=config.steps,
        rate=config.rate, state_path=config.state, resume=config.resume,
    )  # fmt: skip
    card = {
        "kind": "diffusion",
        "config": asdict(config.denoiser),
        "data": streams.sources,
        "truth": TRUTH,
        "steps": config.steps,
        "seed": config.seed,
        "metrics": {key: round(value, 5) for key, value in metrics.items()},
        **dict(config.note),
    }
    checkpoint.save(config.output, fold_gaze(model).state_dict(), card)
    return metrics


def preset(name: str, **settings: Any) -> DiffusionConfig:
    return replace(DiffusionConfig(**settings), **PRESETS[name])
