"""What the peers are built of, in torch: wav2vec 2.0 base and plain transformers, untrained.

Their shapes are those published; what they compute, the time a network takes does not ask.
"""

import torch
from torch import Tensor, nn
from torch.nn import functional

RATE = 16_000
HOP = 320  # of wav2vec 2.0's features
FRONT = ((10, 5), (3, 2), (3, 2), (3, 2), (3, 2), (2, 2), (2, 2))  # kernel, stride


class Wav2Vec2(nn.Module):
    """wav2vec 2.0 base, and HuBERT base, which has the same shape: 7 convolutions, 12 blocks."""

    def __init__(self, frames: int, dim: int = 768) -> None:
        super().__init__()
        self.frames = frames
        inputs = [1] + [512] * 6
        self.front = nn.ModuleList(
            nn.Conv1d(width, 512, kernel, stride, bias=False)
            for width, (kernel, stride) in zip(inputs, FRONT, strict=True)
        )
        self.first_norm = nn.GroupNorm(512, 512)  # over the whole clip
        self.norm, self.project = nn.LayerNorm(512), nn.Linear(512, dim)
        self.place = nn.Conv1d(dim, dim, 128, padding=64, groups=16)
        self.blocks = encoder(12, dim, 3072, 12)

    def forward(self, sound: Tensor) -> Tensor:
        """sound [B, T] at 16 kHz -> [B, frames, 768], resampled to the face's rate."""
        x = sound[:, None]
        for i, conv in enumerate(self.front):
            x = conv(x)
            x = functional.gelu(self.first_norm(x) if i == 0 else x)
        x = functional.interpolate(x, size=self.frames, mode="linear", align_corners=True)
        x = self.project(self.norm(x.transpose(1, 2)))
        x = x + functional.gelu(self.place(x.transpose(1, 2))[..., :-1]).transpose(1, 2)
        return self.blocks(x)


def encoder(layers: int, dim: int, ff_dim: int, heads: int) -> nn.Module:
    """Attention over the whole clip."""
    block = nn.TransformerEncoderLayer(dim, heads, ff_dim, 0.0, "gelu", batch_first=True)
    return nn.TransformerEncoder(block, layers, enable_nested_tensor=False)


class SequenceDecoder(nn.Module):
    """A transformer decoder from a sequence and a memory to numbers a frame."""

    def __init__(
        self, layers: int, dim: int, ff_dim: int, heads: int, memory: int, inputs: int, outputs: int
    ) -> None:
        super().__init__()
        block = nn.TransformerDecoderLayer(dim, heads, ff_dim, 0.0, "gelu", batch_first=True)
        self.blocks = nn.TransformerDecoder(block, layers)
        self.enter, self.remember = nn.Linear(inputs, dim), nn.Linear(memory, dim)
        self.leave = nn.Linear(dim, outputs)

    def forward(self, x: Tensor, memory: Tensor) -> Tensor:
        """x [B, T, inputs], memory [B, S, memory] -> [B, T, outputs]."""
        return self.leave(self.blocks(self.enter(x), self.remember(memory)))


class Convolutions(nn.Module):
    """Residual convolutions over time."""

    def __init__(self, layers: int, inputs: int, dim: int, outputs: int) -> None:
        super().__init__()
        self.enter = nn.Conv1d(inputs, dim, 3, padding=1)
        self.blocks = nn.ModuleList(nn.Conv1d(dim, dim, 3, padding=1) for _ in range(layers))
        self.leave = nn.Conv1d(dim, outputs, 1)

    def forward(self, x: Tensor) -> Tensor:
        """x [B, T, inputs] -> [B, T, outputs]."""
        y = self.enter(x.transpose(1, 2))
        for block in self.blocks:
            y = y + functional.leaky_relu(block(y), 0.2)
        return self.leave(y).transpose(1, 2)


class VectorQuantised(nn.Module):
    """CodeTalker's face decoder: nearest codes, then a transformer to vertices."""

    def __init__(self, codes: int, code_dim: int, per_frame: int, vertices: int) -> None:
        super().__init__()
        self.codes = nn.Embedding(codes, code_dim)
        self.blocks = encoder(6, code_dim * per_frame, 1536, 8)
        self.leave = nn.Linear(code_dim * per_frame, vertices)

    def forward(self, x: Tensor) -> Tensor:
        """x [B, T, per_frame * code_dim] -> [B, T, vertices]."""
        parts = x.reshape(-1, self.codes.embedding_dim)
        table = self.codes.weight
        far = parts.square().sum(1, keepdim=True) - 2 * parts @ table.T + table.square().sum(1)
        nearest = torch.argmin(far, 1)
        return self.leave(self.blocks(self.codes(nearest).reshape(x.shape)))
