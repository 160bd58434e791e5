"""Raw waveform -> audio features, zero lookahead (paper section 4.3, appendix "audio encoders").

One network form, two sizes: strided causal convolutions shorten the waveform, causal convolutions
with residuals add context. `compact` runs at 24 kHz (exactly 4 features of 128 a 30 FPS tick),
`wav2vec-large` at 16 kHz has the shape of the fairseq model, so its weights can be imported.
Loudness: wav2vec normalises over the whole clip, which is not causal. Here the first layer divides
by running statistics of the past (the config states this), all other layers by frozen ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from math import exp, prod
from typing import Literal

import torch
from torch import Tensor, nn
from torch.nn import functional

from encoder.streaming import CausalConv, State

Layer = tuple[int, int, int]  # width, kernel, stride


@dataclass(frozen=True, kw_only=True)
class AudioEncoderConfig:
    kind: Literal["compact", "wav2vec-large"] = "compact"
    sample_rate: int = 24_000
    layers: tuple[Layer, ...] = ((64, 10, 5), (128, 10, 5), (192, 4, 2), (256, 4, 2), (256, 4, 2))
    context: tuple[tuple[int, int], ...] = tuple((3, 2**i) for i in range(6))  # kernel, dilation
    feature_dim: int = 128  # 0: no projection, features are as wide as the last layer
    first_norm: Literal["running", "frozen"] = "running"  # all other layers are always frozen
    norm_seconds: float = 4.0  # time constant of the running statistics, and weight of their prior
    norm_floor: float = 0.03  # share of the prior's variance that silence cannot fall below

    @property
    def stride(self) -> int:
        return prod(stride for _, _, stride in self.layers)

    @property
    def width(self) -> int:
        return self.feature_dim or self.layers[-1][0]


PRESETS = {
    "debug": AudioEncoderConfig(
        layers=((8, 10, 5), (16, 10, 5), (16, 4, 2), (16, 4, 2), (32, 4, 2)),
        context=((3, 1), (3, 4)),
    ),
    "default": AudioEncoderConfig(),
    "paper": AudioEncoderConfig(
        kind="wav2vec-large",
        sample_rate=16_000,
        layers=(
            (512, 10, 5), (512, 8, 4), (512, 4, 2), (512, 4, 2), (512, 4, 2),
            (512, 1, 1), (512, 1, 1),
        ),
        context=tuple((kernel, 1) for kernel in range(2, 14)),
        feature_dim=0,
    ),
}  # fmt: skip


def running_mean(x: Tensor, start: Tensor, keep: float) -> Tensor:
    """Exponential mean of x [B, N, C] along N from start [B, C]; it includes the n-th input."""
    means, mean = [], start
    if x.shape[1] <= 16:
        for n in range(x.shape[1]):
            mean = keep * mean + (1 - keep) * x[:, n]
            means.append(mean[:, None])
        return torch.cat(means, 1) if means else x
    for part in x.split(256, 1):  # many at once: a cumulative sum of the inputs, scaled by age
        age = torch.arange(1, part.shape[1] + 1, dtype=torch.float64, device=x.device)[:, None]
        decay = (keep**age).to(x.dtype)
        means.append(decay * (mean[:, None] + ((1 - keep) * part / decay).cumsum(1)))
        mean = means[-1][:, -1]
    return torch.cat(means, 1)


class RunningNorm(nn.Module):
    """Automatic gain: mean and variance over channels and the past, updated once a feature hop.

    The prior (where a stream starts) is learned from the training batches' own statistics.
    """

    prior: Tensor

    def __init__(self, width: int, hop: int, keep: float, floor: float) -> None:
        super().__init__()
        self.hop, self.keep, self.floor = hop, keep, floor
        self.weight = nn.Parameter(torch.ones(width))
        self.bias = nn.Parameter(torch.zeros(width))
        self.register_buffer("prior", torch.tensor([0.0, 1e-3]))  # mean, mean square

    def init_statistics(self, batch: int) -> Tensor:  # -> [B, 2]
        return self.prior.expand(batch, 2).clone()

    def step(self, x: Tensor, statistics: Tensor) -> tuple[Tensor, Tensor]:
        """x [B, C, N * hop], statistics [B, 2] -> the same, normalised; the next statistics."""
        batch, width, time = x.shape
        hops = x.reshape(batch, width, time // self.hop, self.hop)
        moments = torch.stack([hops.mean((1, 3)), hops.square().mean((1, 3))], -1)  # [B, N, 2]
        moments = moments.to(self.prior)  # half precision would not sum over seconds
        if self.training:
            with torch.no_grad():
                self.prior.lerp_(moments.mean((0, 1)), 0.02)
        means = running_mean(moments, statistics, self.keep)
        floor = self.floor * (self.prior[1] - self.prior[0] ** 2) + 1e-9
        mean, variance = means[..., 0], (means[..., 1] - means[..., 0] ** 2).clamp(min=0) + floor
        hops = (hops - mean[:, None, :, None]) * variance.rsqrt()[:, None, :, None]
        y = hops.reshape(x.shape) * self.weight[:, None] + self.bias[:, None]
        return y, means[:, -1] if time else statistics


class FrozenNorm(nn.BatchNorm1d):
    """Per-channel scale that is a constant when streaming: batch statistics in training only."""


class AudioEncoder(nn.Module):
    """Waveform x [B, T, 1] at config.sample_rate -> features [B, T / stride, width]."""

    delay = 0

    def __init__(self, config: AudioEncoderConfig) -> None:
        super().__init__()
        self.config = config
        self.block_size = config.stride
        self.ratio = Fraction(1, config.stride)
        hop = config.stride // config.layers[0][2]
        keep = exp(-config.stride / config.sample_rate / config.norm_seconds)
        widths = [1] + [width for width, _, _ in config.layers]
        self.convs = nn.ModuleList(
            CausalConv(widths[i], width, kernel, stride, bias=False)
            for i, (width, kernel, stride) in enumerate(config.layers)
        )
        self.norms = nn.ModuleList(FrozenNorm(width) for width in widths[1:])
        if config.first_norm == "running":
            self.norms[0] = RunningNorm(widths[1], hop, keep, config.norm_floor)
        last = widths[-1]
        self.context_convs = nn.ModuleList(
            CausalConv(last, last, kernel, dilation=dilation) for kernel, dilation in config.context
        )
        self.context_norms = nn.ModuleList(FrozenNorm(last) for _ in config.context)
        self.project = nn.Linear(last, config.feature_dim) if config.feature_dim else nn.Identity()

    def layers(self) -> list[tuple[CausalConv, RunningNorm | FrozenNorm]]:
        """Every convolution with its norm, in the order of the flow: strided ones, then context."""
        convs = [*self.convs, *self.context_convs]
        norms = [*self.norms, *self.context_norms]
        return list(zip(convs, norms, strict=True))  # type: ignore[arg-type]

    def init_state(self, batch: int) -> State:
        state = {f"conv{i}": c.init_context(batch) for i, (c, _) in enumerate(self.layers())}
        first = self.layers()[0][1]
        if isinstance(first, RunningNorm):
            state["statistics"] = first.init_statistics(batch)
        return state

    def step(self, x: Tensor, state: State) -> tuple[Tensor, State]:
        """x [B, T, 1] with T a multiple of the stride -> features [B, T / stride, width]."""
        if x.shape[1] == 0:
            return x.new_zeros(x.shape[0], 0, self.config.width), state
        _, context, state = self.hidden(x, state)
        return self.project(context), state

    def hidden(self, x: Tensor, state: State) -> tuple[Tensor, Tensor, State]:
        """x [B, T, 1] -> latents of the strided layers, their context [B, T / stride, C], state."""
        state, x, latents = dict(state), x.transpose(1, 2), x
        for i, (conv, norm) in enumerate(self.layers()):
            if i == len(self.convs):
                latents = x
            y, state[f"conv{i}"] = conv.step(x, state[f"conv{i}"])
            if isinstance(norm, RunningNorm):
                y, state["statistics"] = norm.step(y, state["statistics"])
            else:
                y = norm(y)
            x = self.join(i, x, functional.relu(y))
        return latents.transpose(1, 2), x.transpose(1, 2), state

    def join(self, i: int, x: Tensor, y: Tensor) -> Tensor:
        """What leaves layer i with input x and activation y: log compression, then residuals."""
        if i >= len(self.convs):
            return (y + x) * 0.5**0.5
        return torch.log1p(y) if i == len(self.convs) - 1 else y

    def forward(self, x: Tensor) -> Tensor:  # [B, T, 1] -> [B, T / stride, width]
        return self.step(x, self.init_state(x.shape[0]))[0]
