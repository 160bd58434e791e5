"""The streaming contract of every causal module, and the causal convolution they are built of.

A module runs on a whole sequence with `forward` or piece by piece with `step`; both give the same
numbers. State is a value: `step` returns a new one and never writes into the old one.
Used by everything between raw samples and the expression code (paper section 4.3, "causality").
"""

from __future__ import annotations

from fractions import Fraction
from typing import Protocol, runtime_checkable

import torch
from torch import Tensor, nn
from torch.nn import functional

State = dict[str, Tensor]
LONG = 160  # from this number of outputs on, the library's convolution is faster


@runtime_checkable
class Streamable(Protocol):
    """A module with state, run piece by piece or at once.

    block_size: `step` takes a multiple of this many input items.
    ratio: output items per input item; after n inputs at least floor(n * ratio) outputs exist.
    delay: output k depends on inputs up to ceil((k + 1) / ratio) - 1 - delay and on no later one.
    """

    block_size: int
    ratio: Fraction
    delay: int

    def init_state(self, batch: int) -> State: ...

    def step(self, x: Tensor, state: State) -> tuple[Tensor, State]: ...

    def forward(self, x: Tensor) -> Tensor: ...


class CausalConv(nn.Conv1d):
    """A convolution that sees only the past; its state is the last span - stride inputs.

    Inputs before the start of the stream are zeros.
    """

    @property
    def context(self) -> int:
        return self.dilation[0] * (self.kernel_size[0] - 1) + 1 - self.stride[0]

    def init_context(self, batch: int) -> Tensor:  # -> [B, C, context]
        return self.weight.new_zeros(batch, self.in_channels, self.context)

    def step(self, x: Tensor, context: Tensor) -> tuple[Tensor, Tensor]:
        """x [B, C, T], context [B, C, context] -> y [B, C', T / stride], the next context."""
        x = torch.cat([context, x], -1)
        kept = x[..., x.shape[-1] - self.context :]
        if x.shape[-1] > LONG * self.stride[0] + self.context:
            y = functional.conv1d(x, self.weight, self.bias, self.stride, 0, self.dilation)
            return y, kept
        # A tick is short: one product of its windows takes 0.1 ms on one thread, where PyTorch's
        # dilated convolution of 4 frames takes 1 ms. (For whole clips this way is slower.)
        span = self.context + self.stride[0]
        windows = x.unfold(-1, span, self.stride[0])[..., :: self.dilation[0]]  # [B, C, T', k]
        rows = windows.transpose(1, 2).flatten(2)
        y = functional.linear(rows, self.weight.flatten(1), self.bias).transpose(1, 2)
        return y, kept


class Buffered(nn.Module):
    """Lets a module with a block size take any number of items [B, T, C]; the rest waits in the
    state."""

    block_size = 1

    def __init__(self, inner: nn.Module, channels: int) -> None:
        super().__init__()
        self.inner = inner
        self.channels = channels
        self.ratio: Fraction = inner.ratio  # type: ignore[assignment]
        self.delay: int = inner.delay  # type: ignore[assignment]

    def init_state(self, batch: int) -> State:
        state = self.inner.init_state(batch)  # type: ignore[operator]
        like = next(iter([*self.inner.parameters(), *self.inner.buffers()]), torch.zeros(()))
        return {**state, "pending": like.new_zeros(batch, 0, self.channels)}

    def step(self, x: Tensor, state: State) -> tuple[Tensor, State]:
        state = dict(state)
        x = torch.cat([state.pop("pending"), x], 1)
        ready = x.shape[1] - x.shape[1] % self.inner.block_size  # type: ignore[operator]
        y, state = self.inner.step(x[:, :ready], state)  # type: ignore[operator]
        return y, {**state, "pending": x[:, ready:]}

    def forward(self, x: Tensor) -> Tensor:  # [B, T, C] -> [B, floor(T * ratio), C']
        return self.step(x, self.init_state(x.shape[0]))[0]
