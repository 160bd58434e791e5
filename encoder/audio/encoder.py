"""Raw waveform -> audio features, zero lookahead (paper section 4.3, appendix "audio encoders").

One network form, three kinds, alone or two side by side. `phonetic` hears log spectra at 24 kHz
(spectrum.py) and says which phone and viseme sounds, as log-odds, with voicing, pitch and loudness:
74 numbers, four times a 30 FPS tick. So narrow a passage lets what is said through and little of
who says it. In the others strided causal convolutions shorten the waveform: `compact`, at 24 kHz
(four features of 128 a tick), `wav2vec-large` at 16 kHz in the shape of the fairseq model, so that
its weights can be imported. The shipped encoder is `compact` with `phonetic` as its second. In
wav2vec loudness is normalised over the whole clip, which is not causal: here the first layer
divides by running statistics of the past (the config states this), all other layers by frozen ones.
"""

from __future__ import annotations

from fractions import Fraction
from math import exp

import torch
from torch import Tensor, nn
from torch.nn import functional

from encoder.audio.config import SECOND, AudioEncoderConfig
from encoder.audio.spectrum import Spectrum, running_mean
from encoder.nn.streaming import CausalConv, State


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
        self.spectrum = Spectrum(config.spectrum) if config.spectrum else None
        widths = [config.bands or 1] + [width for width, _, _ in config.layers]
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
        self.second = AudioEncoder(config.second) if config.second else None
        assert not config.second or config.second.stride == config.stride

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
        if self.second:
            state |= {SECOND + k: v for k, v in self.second.init_state(batch).items()}
        return state | (self.spectrum.init_state(batch) if self.spectrum else {})

    def step(self, x: Tensor, state: State) -> tuple[Tensor, State]:
        """x [B, T, 1] with T a multiple of the stride -> features [B, T / stride, widths]."""
        if x.shape[1] == 0:
            return x.new_zeros(x.shape[0], 0, sum(w for w, _ in self.config.parts)), state
        if self.second:
            theirs = {k: v for k, v in state.items() if k.startswith(SECOND)}
            own, after = self.alone(x, {k: v for k, v in state.items() if k not in theirs})
            theirs = {k.removeprefix(SECOND): v for k, v in theirs.items()}
            other, heard = self.second.step(x, theirs)
            after |= {SECOND + k: v for k, v in heard.items()}
            return torch.cat([own, other], -1), after
        return self.alone(x, state)

    def alone(self, x: Tensor, state: State) -> tuple[Tensor, State]:
        """`step` without the second encoder."""
        state = dict(state)
        if self.spectrum:
            x, heard = self.spectrum.step(x, state)
            state |= heard
        context, state = self.layered(x, state)
        return self.project(context), state

    def layered(self, x: Tensor, state: State) -> tuple[Tensor, State]:
        """Waveform or log spectra x [B, N, C] -> what the last layer says [B, N', C'], state."""
        state, x = dict(state), x.transpose(1, 2)
        for i, (conv, norm) in enumerate(self.layers()):
            y, state[f"conv{i}"] = conv.step(x, state[f"conv{i}"])
            if isinstance(norm, RunningNorm):
                y, state["statistics"] = norm.step(y, state["statistics"])
            else:
                y = norm(y)
            x = self.join(i, x, functional.relu(y))
        return x.transpose(1, 2), state

    def join(self, i: int, x: Tensor, y: Tensor) -> Tensor:
        """What leaves layer i with input x and activation y: log compression, then residuals."""
        if i >= len(self.convs):
            return (y + x) * 0.5**0.5
        last = i == len(self.convs) - 1 and not self.config.bands
        return torch.log1p(y) if last else y

    def forward(self, x: Tensor) -> Tensor:  # [B, T, 1] -> [B, T / stride, width]
        return self.step(x, self.init_state(x.shape[0]))[0]
