"""Self-attention with rotary positions (RoPE), over new frames and cached ones.

Paper appendix "Online Transformer Architecture".
"""

from math import log, pi
from typing import Literal

import torch
from torch import Tensor, nn
from torch.nn import functional


def rope_angles(positions: Tensor, head_dim: int) -> tuple[Tensor, Tensor]:
    """positions [T] int64 -> cos, sin [T, head_dim / 2] float64.

    Reduced mod 2 pi in float64: float32 angles are 0.1 rad wrong after a day at 30 FPS.
    """
    step = torch.arange(0, head_dim, 2, dtype=torch.float64, device=positions.device)
    angles = positions[:, None].double() * torch.exp(step * (-log(10_000.0) / head_dim))
    angles = torch.remainder(angles, 2 * pi)
    return angles.cos(), angles.sin()


def rotate(x: Tensor, cos: Tensor, sin: Tensor) -> Tensor:
    """Rotary embedding of x [B, H, T, D] by cos, sin [T, D / 2]; pairs are the two halves."""
    a, b = x.chunk(2, -1)
    return torch.cat([a * cos - b * sin, a * sin + b * cos], -1)


class Attention(nn.Module):
    """Self-attention over the window; new frames attend to cached ones and to each other.

    `forward` returns the output [B, T, dim] and the keys and values [B, H, w + T, D] to cache.
    """

    def __init__(self, dim: int, heads: int, kind: Literal["softmax", "linear"]) -> None:
        super().__init__()
        self.heads, self.kind = heads, kind
        self.qkv = nn.Linear(dim, 3 * dim)
        self.out = nn.Linear(dim, dim)

    def forward(
        self,
        x: Tensor,  # [B, T, dim] new frames
        past: tuple[Tensor, Tensor] | None,  # keys (not yet rotated), values [B, H, w, D]
        rope: tuple[Tensor, Tensor],  # cos, sin [w + T, D / 2] (no past: [T, D / 2])
        mask: Tensor,  # [T, w + T] bool
    ) -> tuple[Tensor, tuple[Tensor, Tensor]]:
        batch, time, dim = x.shape
        qkv = self.qkv(x).reshape(batch, time, 3, self.heads, dim // self.heads)
        q, k, v = qkv.permute(2, 0, 3, 1, 4)  # [B, H, T, D]
        if self.kind == "linear":
            q, k = functional.elu(q) + 1, functional.elu(k) + 1
        if past is not None:
            k, v = torch.cat([past[0], k], 2), torch.cat([past[1], v], 2)
        cos, sin = rope
        turned_q, turned_k = rotate(q, cos[-time:], sin[-time:]), rotate(k, cos, sin)
        if self.kind == "softmax":
            y = functional.scaled_dot_product_attention(turned_q, turned_k, v, attn_mask=mask)
        else:  # the appendix's form: RoPE in the numerator only
            scores = (turned_q @ turned_k.transpose(2, 3)) * mask
            total = ((q @ k.transpose(2, 3)) * mask).sum(-1, keepdim=True)
            y = scores @ v / total
        return self.out(y.transpose(1, 2).reshape(batch, time, dim)), (k, v)
