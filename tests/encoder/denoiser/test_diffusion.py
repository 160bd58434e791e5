"""The schedule, DDIM on a distribution with a known answer, guidance formulas, keyed noise."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor

from encoder.denoiser.diffusion import Guidance, Schedule, ddim_taus, guided, sample_ddim
from encoder.driver import frame_noise


def test_schedule_runs_from_clean_to_noise() -> None:
    alpha_bar = Schedule(200).alpha_bar
    assert len(alpha_bar) == 201 and alpha_bar[0] == 1 and alpha_bar[200] < 1e-4
    assert (alpha_bar.diff() < 0).all()


def test_q_sample_has_unit_variance() -> None:
    generator = torch.Generator().manual_seed(0)
    x0, noise = torch.randn(2, 3, 4000, 8, generator=generator)
    tau = torch.tensor([0, 100, 200])
    x = Schedule().q_sample(x0, tau, noise)
    assert torch.equal(x[0], x0[0])
    assert (x.std((1, 2)) - 1).abs().max() < 0.02
    assert (x[2] - noise[2]).abs().max() < 0.05


def test_ddim_recovers_a_known_gaussian() -> None:
    """For data N(3, 0.5^2) the best x0 is known; 40 steps must turn noise into that Gaussian."""
    schedule, mean, variance = Schedule(), 3.0, 0.25

    def model(x: Tensor, tau: Tensor, conditioned: bool) -> Tensor:
        signal, sigma = schedule.coefficients(tau, x)
        gain = variance * signal / (signal**2 * variance + sigma**2)
        return mean + gain * (x - signal * mean)

    generator = torch.Generator().manual_seed(0)
    noise = torch.randn(4, 2000, 4, generator=generator)
    y = sample_ddim(model, noise, ddim_taus(200, 40), schedule=schedule)
    assert abs(float(y.mean()) - mean) < 0.02 and abs(float(y.std()) - 0.5) < 0.03


def test_forty_steps_and_one() -> None:
    assert ddim_taus(200, 40)[:2] == [200, 195] and ddim_taus(200, 40)[-1] == 5
    assert ddim_taus(200, 1) == [200]


@pytest.mark.parametrize(
    ("guidance", "expected", "calls"),
    [
        (None, 3.0, 1),
        (Guidance(weight=1.0, formula="interpolate"), 3.0, 1),
        (Guidance(weight=2.0, formula="interpolate"), 5.0, 2),
        (Guidance(weight=1.0, formula="extrapolate"), 5.0, 2),
    ],
)
def test_guidance_formulas(guidance: Guidance | None, expected: float, calls: int) -> None:
    seen = []

    def model(x: Tensor, tau: Tensor, conditioned: bool) -> Tensor:
        seen.append(conditioned)
        return torch.full_like(x, 3.0 if conditioned else 1.0)

    y = guided(model, torch.zeros(1, 2, 3), torch.tensor([200]), guidance)
    assert float(y.mean()) == expected and len(seen) == calls


def test_noise_depends_on_seed_and_index_only() -> None:
    late = frame_noise(3, 10_000_000, 256)
    frame_noise(3, 0, 256)
    assert np.array_equal(frame_noise(3, 10_000_000, 256), late)
    assert not np.array_equal(frame_noise(4, 10_000_000, 256), late)
    many = np.concatenate([frame_noise(3, i, 256) for i in range(500)])
    assert abs(many.mean()) < 0.01 and abs(many.std() - 1) < 0.01
    assert abs(np.mean(many[256:] * many[:-256])) < 0.01
