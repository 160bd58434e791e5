"""48 kHz -> 24 or 16 kHz: a causal windowed-sinc filter that drops samples, first thing after the
microphone. Its ringing is symmetric, so sound arrives `group_delay` input samples late (0.4 ms).
"""

from __future__ import annotations

from fractions import Fraction

import torch
from torch import Tensor, nn
from torch.nn import functional

from encoder.streaming import State


class Resample(nn.Module):
    """Integer decimation. 38 taps at factor 2, 57 at factor 3 (FACTS: 19 samples a phase)."""

    delay = 0

    def __init__(self, factor: int, taps_per_phase: int = 19) -> None:
        super().__init__()
        self.block_size = factor
        self.ratio = Fraction(1, factor)
        taps = factor * taps_per_phase
        self.context = taps - factor
        self.group_delay = (taps - 1) / 2
        time = torch.arange(taps, dtype=torch.float64) - self.group_delay
        cutoff = 0.9 / factor  # of the input's Nyquist frequency; the window's skirt takes the rest
        window = torch.kaiser_window(taps, periodic=False, beta=8.0, dtype=torch.float64)
        kernel = torch.sinc(cutoff * time) * window
        kernel = (kernel / kernel.sum()).float()
        self.kernel: Tensor
        self.register_buffer("kernel", kernel.reshape(1, 1, -1), persistent=False)

    def init_state(self, batch: int) -> State:
        return {"context": self.kernel.new_zeros(batch, self.context, 1)}

    def step(self, x: Tensor, state: State) -> tuple[Tensor, State]:
        """x [B, T, 1] -> [B, T / factor, 1]; T is a multiple of the factor."""
        x = torch.cat([state["context"], x], 1)
        kept = x[:, x.shape[1] - self.context :]
        if x.shape[1] == self.context:  # nothing new
            return x[:, :0], {"context": kept}
        y = functional.conv1d(x.transpose(1, 2), self.kernel, stride=self.block_size)
        return y.transpose(1, 2), {"context": kept}

    def forward(self, x: Tensor) -> Tensor:  # [B, T, 1] -> [B, T / factor, 1]
        return self.step(x, self.init_state(x.shape[0]))[0]
