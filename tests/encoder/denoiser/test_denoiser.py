"""The denoiser keeps the contract of streams, with junk in what it must not read."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import pytest
import torch
from contracts import check_streaming, lively, noise
from torch import Tensor, nn

from encoder.denoiser.config import DenoiserConfig
from encoder.denoiser.model import Denoiser
from encoder.nn.streaming import State


class DenoiserStream(nn.Module):
    """The denoiser's three inputs side by side, at tau = N, as one Streamable."""

    block_size, ratio, delay = 1, Fraction(1), 0

    def __init__(self, config: DenoiserConfig) -> None:
        super().__init__()
        self.inner = lively(Denoiser(config))
        self.sizes = [config.expression_dim, config.audio_dim, config.condition_dim]

    def init_state(self, batch: int) -> State:
        return self.inner.init_state(batch)

    def step(self, x: Tensor, state: State) -> tuple[Tensor, State]:
        noisy, audio, condition = x.split(self.sizes, -1)
        return self.inner.step(noisy, self.tau(x), audio, condition, state)

    def forward(self, x: Tensor) -> Tensor:
        noisy, audio, condition = x.split(self.sizes, -1)
        return self.inner(noisy, self.tau(x), audio, condition)

    def tau(self, x: Tensor) -> Tensor:
        return torch.full((len(x),), 200)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("attention", ["softmax", "linear"])
def test_denoiser(attention: str, dtype: torch.dtype) -> None:
    config = DenoiserConfig(
        expression_dim=12, audio_dim=8, layers=2, dim=32, ff_dim=48, window=5, attention=attention,
        contact=6, direct_dim=3, direct=4,
    )  # fmt: skip
    stream = DenoiserStream(config).to(dtype)
    assert stream.inner.contact is not None and stream.inner.direct is not None
    heads = stream.inner.contact, stream.inner.direct
    for tensor in (t for head in heads for t in (*head.buffers(), *head.parameters())):
        torch.nn.init.normal_(tensor)
    x = noise(2, 30, 26, dtype=dtype)
    # Offline the mask multiplies the future by an exact 0, and 0 * NaN is NaN: large numbers.
    check_streaming(stream, x, stale=Denoiser.stale, junk=(1e3, -1e3))


def test_denoiser_far_past_the_training_length() -> None:
    stream = DenoiserStream(replace(DenoiserConfig(), layers=2, dim=32, ff_dim=48, audio_dim=8))
    x = noise(1, 400, 256 + 8 + 6)
    with torch.no_grad():
        expected, state = stream(x), stream.init_state(1)
        for t in range(400):
            y, state = stream.step(x[:, t : t + 1], state)
            assert (y[:, 0] - expected[:, t]).abs().max() < 1e-5
