"""The diffusion process on expression codes (paper section 4.1): schedule, noise, DDIM, guidance.

The network predicts the clean code x0. tau runs 0 (clean) .. N (noise) and is never called t.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import cos, pi
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

# (x_tau [B, T, C], tau [B] int64, conditioned) -> x0 [B, T, C]
Model = Callable[[Tensor, Tensor, bool], Tensor]
NoiseSource = Callable[[Sequence[int]], Tensor]


@dataclass(frozen=True, kw_only=True)
class Guidance:
    """Classifier-free guidance with conditional output c and unconditional output u.

    "interpolate": u + w (c - u), so w = 1 is no guidance. "extrapolate": (1 + w) c - w u, so w = 1
    is strong guidance. The paper says "weight 1.0" without a formula, so both are named.
    """

    weight: float = 1.0
    formula: Literal["interpolate", "extrapolate"] = "interpolate"

    @property
    def factor(self) -> float:
        """The g in u + g (c - u)."""
        return self.weight + (self.formula == "extrapolate")


class Schedule:
    """Cosine schedule: alpha_bar[tau] for tau = 0..N, float64 inside."""

    def __init__(self, num_steps: int = 200) -> None:
        self.num_steps = num_steps
        curve = [cos((i / num_steps + 0.008) / 1.008 * pi / 2) ** 2 for i in range(num_steps + 1)]
        alphas = [max(b / a, 0.001) for a, b in zip(curve, curve[1:], strict=False)]
        self.alpha_bar = torch.tensor([1.0, *alphas], dtype=torch.float64).cumprod(0)

    def coefficients(self, tau: Tensor, like: Tensor) -> tuple[Tensor, Tensor]:
        """tau [B] -> signal and noise factors [B, 1, ..] that fit `like` [B, ..]."""
        alpha_bar = self.alpha_bar[tau.cpu()].reshape(-1, *[1] * (like.ndim - 1))
        return alpha_bar.sqrt().to(like), (1 - alpha_bar).sqrt().to(like)

    def q_sample(self, x0: Tensor, tau: Tensor, noise: Tensor) -> Tensor:
        """Clean codes x0 [B, T, C], tau [B] int64, noise [B, T, C] -> noisy codes [B, T, C]."""
        signal, sigma = self.coefficients(tau, x0)
        return signal * x0 + sigma * noise


def guided(model: Model, x: Tensor, tau: Tensor, guidance: Guidance | None) -> Tensor:
    """One prediction with guidance: u + g (c - u); g = 1 costs one evaluation, else two."""
    conditional = model(x, tau, True)
    if guidance is None or guidance.factor == 1.0:
        return conditional
    unconditional = model(x, tau, False)
    return unconditional + guidance.factor * (conditional - unconditional)


def ddim_taus(num_steps: int, steps: int) -> list[int]:
    """The visited tau, from N down: 200 in 40 steps -> 200, 195, .., 5."""
    return [round(num_steps * i / steps) for i in range(steps, 0, -1)]


def sample_ddim(
    model: Model,
    shape: Sequence[int],  # [B, T, C]
    noise_source: NoiseSource,
    *,
    schedule: Schedule,
    steps: int = 40,
    guidance: Guidance | None = None,
    start: Tensor | None = None,  # x at tau = N, instead of fresh noise
) -> Tensor:
    """Deterministic DDIM (eta 0, Song et al. 2021, eq. 12) -> x0 [B, T, C]."""
    x = noise_source(shape) if start is None else start
    taus = ddim_taus(schedule.num_steps, steps)
    for tau, tau_next in zip(taus, [*taus[1:], 0], strict=True):
        batch_tau = torch.full((shape[0],), tau, dtype=torch.int64, device=x.device)
        x0 = guided(model, x, batch_tau, guidance)
        signal, sigma = schedule.coefficients(batch_tau, x)
        x = schedule.q_sample(x0, torch.full_like(batch_tau, tau_next), (x - signal * x0) / sigma)
    return x


def frame_noise(seed: int, index: int, dim: int) -> NDArray[np.float32]:
    """Gaussian noise [dim] of one frame, a function of (seed, frame index) and nothing else."""
    bits = np.random.Philox(key=seed, counter=[0, 0, 0, index])
    return np.random.Generator(bits).standard_normal(dim, dtype=np.float32)
