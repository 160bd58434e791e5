"""The diffusion process on expression codes (paper section 4.1): schedule, noise, DDIM, guidance.

The network predicts the clean code x0. tau runs 0 (clean) .. N (noise) and is never called t.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import cos, pi
from typing import Literal

import torch
from torch import Tensor

# (x_tau [B, T, C], tau [B] int64, conditioned) -> x0 [B, T, C]
Model = Callable[[Tensor, Tensor, bool], Tensor]


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


def conditioned_on(denoiser: Callable[..., Tensor], audio: Tensor, gaze: Tensor) -> Model:
    """`denoiser` that hears `audio` [B, T, A], or nothing where it is not conditioned."""
    nothing = torch.zeros(len(audio), dtype=torch.bool, device=audio.device)

    def model(x: Tensor, tau: Tensor, conditioned: bool) -> Tensor:
        return denoiser(x, tau, audio, gaze, keep_audio=None if conditioned else nothing)

    return model


def ddim_taus(num_steps: int, steps: int) -> list[int]:
    """The visited tau, from N down: 200 in 40 steps -> 200, 195, .., 5."""
    return [round(num_steps * i / steps) for i in range(steps, 0, -1)]


@torch.no_grad()
def sample_ddim(
    model: Model,
    x: Tensor,  # [B, T, C] at taus[0]
    taus: Sequence[int],  # visited, from high to low; then comes 0
    *,
    schedule: Schedule,
    guidance: Guidance | None = None,
) -> Tensor:
    """Deterministic DDIM (eta 0, Song et al. 2021, eq. 12) -> x0 [B, T, C]."""
    for tau, tau_next in zip(taus, [*taus[1:], 0], strict=True):
        here = torch.full((len(x),), tau, dtype=torch.int64, device=x.device)
        x0 = guided(model, x, here, guidance)
        signal, sigma = schedule.coefficients(here, x)
        noise = (x - signal * x0) / sigma
        x = schedule.q_sample(x0, torch.full_like(here, tau_next), noise)
    return x
