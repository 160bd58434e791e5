"""48 kHz -> 24 or 16 kHz: a causal windowed-sinc filter that drops samples, first thing after the
microphone. Its ringing is symmetric, so sound arrives `group_delay` input samples late (0.4 ms).
"""

from __future__ import annotations

from fractions import Fraction

import torch
from torch import Tensor, nn
from torch.nn import functional

from encoder.audio.framing import resample_kernel
from encoder.nn.streaming import State


class Resample(nn.Module):
    """Integer decimation by the filter of framing.py."""

    delay = 0

    def __init__(self, factor: int) -> None:
        super().__init__()
        self.block_size = factor
        self.ratio = Fraction(1, factor)
        kernel = torch.from_numpy(resample_kernel(factor))
        self.context = len(kernel) - factor
        self.group_delay = (len(kernel) - 1) / 2
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
