"""Zero convolutions: what an emotion adds between the blocks of the frozen denoiser (paper 5.1).

y' = y + Z(c): a 1x1 convolution of the emotion's 512 numbers c before every Transformer block,
before the output and, unlike the paper, after it: the frozen output layer has hardly seen a smile,
and what its columns do not hold nothing before it can reach. All start at zero, so an untrained one
changes nothing. c does not change over time, and so each Z(c) is one vector: the live path adds a
few constants and runs no convolution.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from encoder.denoiser import DenoiserConfig

EMBEDDING = 512  # the paper's, of CLIP
OUTPUT_GAIN = 10.0  # a smile lies 15 standard deviations away from the codes of neutral speech


@dataclass(frozen=True, kw_only=True)
class ZeroConvConfig:
    labels: tuple[str, ...]
    layers: int  # blocks
    dim: int
    expression_dim: int = 256
    embedding: int = EMBEDDING

    @property
    def width(self) -> int:
        """Of all that is added: `dim` before each block and before the output, then the code."""
        return (self.layers + 1) * self.dim + self.expression_dim

    @staticmethod
    def of(denoiser: DenoiserConfig, labels: tuple[str, ...]) -> ZeroConvConfig:
        return ZeroConvConfig(
            labels=labels,
            layers=denoiser.layers,
            dim=denoiser.dim,
            expression_dim=denoiser.expression_dim,
        )


class ZeroConvs(nn.Module):
    """The table of embeddings, one row a label, and a convolution for each place.

    The rows are axes: no label shares weights with another, so all are learned at once in a few
    hundred steps. (From random rows, as CLIP's are, 780 steps came half as far.)
    """

    embeddings: Tensor

    def __init__(self, config: ZeroConvConfig) -> None:
        super().__init__()
        self.config = config
        self.register_buffer("embeddings", torch.eye(len(config.labels), config.embedding))
        self.convs = nn.ModuleList(
            nn.Conv1d(config.embedding, config.dim, 1) for _ in range(config.layers + 1)
        )
        self.output = nn.Conv1d(config.embedding, config.expression_dim, 1)
        for conv in (*self.convs, self.output):
            nn.init.zeros_(conv.weight)  # type: ignore[arg-type]
            nn.init.zeros_(conv.bias)  # type: ignore[arg-type]

    def table(self) -> Tensor:
        """What each label adds at full intensity, place after place: [labels, width]."""
        rows = self.embeddings.T[None]  # [1, 512, labels]: the labels take the place of time
        inner = [conv(rows)[0].T for conv in self.convs]
        return torch.cat([*inner, OUTPUT_GAIN * self.output(rows)[0].T], 1)

    def forward(self, mixture: Tensor) -> Tensor:
        """mixture [B, labels], intensities 0..1 -> [B, width], for `Denoiser.forward`."""
        return mixture @ self.table()
