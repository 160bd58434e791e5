"""Stage 3: distil the teacher into a student that denoises in ONE step (paper section 4.2).

L_distill pulls the student's single prediction to the teacher's iterated one (guidance included);
L_DMD pushes its samples toward where the teacher finds them likelier than the student does;
L_geom keeps the motion of the truth. tau starts on four steps and moves to tau = N (appendix).
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

from encoder import checkpoint
from encoder.denoiser import Denoiser, DenoiserConfig
from encoder.diffusion import Guidance, Schedule, ddim_taus, guided
from encoder.training import loop
from encoder.training.diffusion import (
    TRUTH,
    RigToCode,
    Vertices,
    fold_gaze,
    velocity_loss,
    weighted_error,
)
from encoder.training.streams import Streams


@dataclass(frozen=True, kw_only=True)
class DistillConfig:
    streams: Path
    teacher: Path  # diffusion checkpoint, without suffix
    output: Path
    state: Path
    steps: int = 640
    batch: int = 16
    frames: int = 80
    rate: float = 3e-4
    ddim_steps: int = 6
    pool: int = 16  # batches of teacher samples a phase trains on
    guidance: Guidance = Guidance(weight=1.15)
    dmd_weight: float = 0.05
    velocity_weight: float = 1.0
    truth_weight: float = 2.0  # rest and closures stay the truth's, not an average sample's
    seed: int = 0
    resume: bool = False
    note: tuple[tuple[str, str], ...] = ()


PRESETS: dict[str, dict[str, Any]] = {
    "debug": {"steps": 2, "batch": 2, "frames": 12, "ddim_steps": 4, "pool": 2},
    "default": {},
    "paper": {"steps": 25_000, "frames": 100, "rate": 1e-5, "ddim_steps": 40, "pool": 400},
}
NUM_MODES = 40  # K: Gaussians in the mixture pi(tau), one a DDIM step of the paper
# Weights of tau / N = 0.25, 0.5, 0.75, 1 in each phase: from four steps to one.
PHASES = (
    (0.25, 0.25, 0.25, 0.25),
    (0.1, 0.15, 0.25, 0.5),
    (0.0, 0.05, 0.15, 0.8),
    (0.0, 0.0, 0.0, 1.0),
)


def draw_tau(phase: int, num_steps: int, rng: np.random.Generator) -> int:
    """One tau from pi: a Gaussian of spread sqrt(0.5) / K^2 about a quarter of N."""
    mean = (rng.choice(4, p=PHASES[phase]) + 1) / 4
    tau = rng.normal(mean, 0.5**0.5 / NUM_MODES**2) * num_steps
    return int(np.clip(round(tau), 1, num_steps))


@torch.no_grad()
def iterate(
    teacher: Denoiser,
    x: Tensor,  # [B, T, 256] at `tau`
    tau: int,
    audio: Tensor,
    gaze: Tensor,
    schedule: Schedule,
    config: DistillConfig,
) -> Tensor:
    """E_orig^iter: DDIM from `tau` down, guided -> x0 [B, T, 256]."""
    nothing = torch.zeros(len(x), dtype=torch.bool)

    def model(x: Tensor, tau: Tensor, conditioned: bool) -> Tensor:
        keep = None if conditioned else nothing
        return teacher(x, tau, audio, gaze, keep_audio=keep)

    below = [t for t in ddim_taus(schedule.num_steps, config.ddim_steps) if t < tau]
    for here, there in zip([tau, *below], [*below, 0], strict=True):
        batch_tau = torch.full((len(x),), here)
        x0 = guided(model, x, batch_tau, config.guidance)
        signal, sigma = schedule.coefficients(batch_tau, x)
        x = schedule.q_sample(x0, torch.full_like(batch_tau, there), (x - signal * x0) / sigma)
    return x


def dmd_loss(
    student: Denoiser, teacher: Denoiser, z: Tensor, audio: Tensor, gaze: Tensor, schedule: Schedule
) -> Tensor:
    """A loss whose gradient in z is the normalised difference of the two scores (Yin et al. 2024).

    With x0-predicting networks a score difference at tau is a difference of x0 predictions.
    """
    with torch.no_grad():
        tau = torch.randint(schedule.num_steps // 50, int(0.98 * schedule.num_steps) + 1, (len(z),))
        noisy = schedule.q_sample(z, tau, torch.randn_like(z))
        real, fake = teacher(noisy, tau, audio, gaze), student(noisy, tau, audio, gaze)
        scale = (z - real).abs().mean((1, 2), keepdim=True) + 1e-3
        target = z - (fake - real) / scale.clamp(min=0.05)
    return 0.5 * (z - target).square().mean()


Sample = tuple[Tensor, int, Tensor, Tensor, Tensor, Tensor, Tensor]


def make_pool(
    phase: int, teacher: Denoiser, streams: Streams, schedule: Schedule, config: DistillConfig
) -> list[Sample]:
    """Batches (x_tau, tau, codes, audio, gaze, weight, teacher's x0) of a phase, from its seed."""
    pool = []
    for index in tqdm(range(config.pool), desc=f"teacher {phase}", mininterval=2):
        rng = np.random.default_rng([config.seed, phase, index])
        codes, audio, gaze, weight = streams.draw(config.batch, config.frames, rng)
        tau = draw_tau(phase, schedule.num_steps, rng)
        noise = torch.tensor(rng.standard_normal(codes.shape, dtype=np.float32))
        x = schedule.q_sample(teacher.standardise(codes), torch.full((len(codes),), tau), noise)
        if tau == schedule.num_steps:
            x = noise  # what the live path starts from
        target = iterate(teacher, x, tau, audio, gaze, schedule, config)
        pool.append((x, tau, codes, audio, gaze, weight, target))
    return pool


def losses(
    student: Denoiser,
    teacher: Denoiser,
    sample: Sample,
    schedule: Schedule,
    vertices: Vertices,
    config: DistillConfig,
) -> dict[str, Tensor]:
    x, tau, codes, audio, gaze, weight, target = sample
    z = student(x, torch.full((len(x),), tau), audio, gaze)
    result = {
        "distill": (z - target).square().mean(),
        "truth": weighted_error(z, student.standardise(codes), weight),
        "velocity": velocity_loss(vertices(student.unstandardise(z)), vertices(codes)),
    }
    total = result["distill"] + config.truth_weight * result["truth"]
    total = total + config.velocity_weight * result["velocity"]
    if config.dmd_weight:
        result["dmd"] = dmd_loss(student, teacher, z, audio, gaze, schedule)
        total = total + config.dmd_weight * result["dmd"]
    return result | {"total": total}


def load_denoiser(path: Path, kind: str) -> tuple[Denoiser, dict[str, Any]]:
    tensors, card = checkpoint.load(path, kind)
    model = Denoiser(checkpoint.config_from(DenoiserConfig, card["config"]))
    model.load_state_dict({key: value.float() for key, value in tensors.items()})
    return model, card


def phases_of(
    steps: int, make: Callable[[int], list[Sample]]
) -> Callable[[int], tuple[int, list[Sample]]]:
    """step -> (phase, its pool); a pool is made when its phase begins or is resumed."""
    held: dict[int, list[Sample]] = {}

    def at(step: int) -> tuple[int, list[Sample]]:
        phase = min(step * len(PHASES) // steps, len(PHASES) - 1)
        if phase not in held:
            held.clear()
            held[phase] = make(phase)
        return phase, held[phase]

    return at


def run(config: DistillConfig, rig_to_code: RigToCode, vertices: Vertices) -> dict[str, float]:
    """Distil and write the student with its card; returns the smoothed losses."""
    streams = Streams.load(config.streams, rig_to_code)
    teacher, card = load_denoiser(config.teacher, "diffusion")
    student, _ = load_denoiser(config.teacher, "diffusion")  # starts as the teacher
    for model in (teacher, student):
        fold_gaze(model, inverse=True)
    teacher.requires_grad_(False)
    schedule = Schedule(teacher.config.num_steps)
    at = phases_of(config.steps, lambda phase: make_pool(phase, teacher, streams, schedule, config))

    def step_losses(step: int) -> dict[str, Tensor]:
        _, pool = at(step)
        sample = pool[np.random.default_rng([config.seed, step]).integers(len(pool))]
        return losses(student, teacher, sample, schedule, vertices, config)

    modules = {"student": student}
    metrics = loop.train(
        "distill", modules, loop.adamw(modules, config.rate), step_losses, steps=config.steps,
        rate=config.rate, state_path=config.state, resume=config.resume,
    )  # fmt: skip
    card = {
        "kind": "student",
        "config": asdict(student.config),
        "data": streams.sources,
        "truth": TRUTH,
        "teacher": {key: card[key] for key in ("steps", "seed", "metrics", "sha256")},
        "guidance": asdict(config.guidance),
        "ddim_steps": config.ddim_steps,
        "steps": config.steps,
        "seed": config.seed,
        "metrics": {key: round(value, 5) for key, value in metrics.items()},
        **dict(config.note),
    }
    checkpoint.save(config.output, loop.halved(fold_gaze(student).state_dict()), card)
    return metrics


def preset(name: str, **settings: Any) -> DistillConfig:
    return replace(DistillConfig(**settings), **PRESETS[name])
