"""Sound -> log mel spectra with automatic gain: what the phonetic audio encoder listens to.

First part of `AudioEncoder` where its config has `bands`; nothing in it is learned. Windows of
25 ms end with the newest sample and fall within 6 ms, so that a spectrum is 8 ms old, not 12.5.
Gain: the running peak of the level, which rises at once and falls within seconds, so that a voice
30 dB down looks like a near one, and a pause stays quiet.
"""

from __future__ import annotations

from math import log

import torch
from torch import Tensor, nn

from encoder.audio.config import SpectrumConfig
from encoder.nn.streaming import State


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


def running_peak(x: Tensor, start: Tensor, decay: float) -> Tensor:
    """Largest x [B, N, 1] so far, start [B, 1] included, each less `decay` for every hop since."""
    peaks, peak = [], start
    for part in x.split(1024, 1):
        age = decay * torch.arange(1, part.shape[1] + 1, device=x.device)[:, None]
        peaks.append(torch.maximum((part + age).cummax(1).values, peak[:, None]) - age)
        peak = peaks[-1][:, -1]
    return torch.cat(peaks, 1) if peaks else x


class Spectrum(nn.Module):
    """Waveform [B, hop * N, 1] -> [B, N, bands], about zero mean and unit spread in speech."""

    kernels: Tensor
    bank: Tensor

    def __init__(self, config: SpectrumConfig) -> None:
        super().__init__()
        self.config = config
        for name, matrix in (("kernels", config.kernels()), ("bank", config.bank())):
            self.register_buffer(name, torch.from_numpy(matrix).float(), persistent=False)

    def init_state(self, batch: int) -> State:
        """sound: the last samples; level; peak: log, above that of silence."""
        c, like = self.config, self.bank
        sound = like.new_zeros(batch, c.window - c.hop, 1)
        return {"sound": sound, "level": like.new_zeros(batch, 1), "peak": like.new_zeros(batch, 1)}

    def power(self, x: Tensor) -> Tensor:  # [B, window + hop * (N - 1)] -> [B, N, bins]
        waves = x.unfold(1, self.config.window, self.config.hop) @ self.kernels
        return waves[..., : self.config.bins].square() + waves[..., self.config.bins :].square()

    def step(self, x: Tensor, state: State) -> tuple[Tensor, State]:
        c = self.config
        sound = torch.cat([state["sound"], x], 1)
        bands = self.power(sound[..., 0]) @ self.bank
        levels, peaks = self.gain(bands, state["level"], state["peak"])
        after = {"sound": sound[:, sound.shape[1] - (c.window - c.hop) :]}
        after |= {"level": levels[:, -1], "peak": peaks[:, -1]}
        return self.scaled(bands, peaks), after

    def gain(self, bands: Tensor, level: Tensor, peak: Tensor) -> tuple[Tensor, Tensor]:
        """bands [B, N, bands] after level and peak [B, 1] -> the same at each hop, [B, N, 1]."""
        c = self.config
        levels = running_mean(bands.mean(-1, keepdim=True), level, c.keep)
        return levels, running_peak((levels / c.floor + 1).log(), peak, c.decay)

    def scaled(self, bands: Tensor, peaks: Tensor) -> Tensor:
        relative = bands / (peaks + log(self.config.floor)).exp()
        return ((relative + self.config.quiet).log() + 5) / 3

    def forward(self, x: Tensor) -> Tensor:
        return self.step(x, self.init_state(x.shape[0]))[0]
