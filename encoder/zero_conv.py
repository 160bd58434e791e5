"""Zero convolutions: what an emotion adds between the blocks of the frozen denoiser (paper 5.1).

y' = y + Z(c): a 1x1 convolution of the emotion's 512 numbers c before every Transformer block and
before the output. All start at zero, so an untrained one changes nothing. c does not change over
time, and so each Z(c) is one vector: the live path adds a few constants and runs no convolution.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from encoder.denoiser import DenoiserConfig

EMBEDDING = 512  # the paper's, of CLIP


@dataclass(frozen=True, kw_only=True)
class ZeroConvConfig:
    labels: tuple[str, ...]
    layers: int  # places: blocks + 1
    dim: int
    embedding: int = EMBEDDING

    @staticmethod
    def of(denoiser: DenoiserConfig, labels: tuple[str, ...]) -> ZeroConvConfig:
        return ZeroConvConfig(labels=labels, layers=denoiser.layers + 1, dim=denoiser.dim)


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
            nn.Conv1d(config.embedding, config.dim, 1) for _ in range(config.layers)
        )
        for conv in self.convs:
            nn.init.zeros_(conv.weight)  # type: ignore[arg-type]
            nn.init.zeros_(conv.bias)  # type: ignore[arg-type]

    def table(self) -> Tensor:
        """What each label adds at full intensity: [labels, layers, dim]."""
        rows = self.embeddings.T[None]  # [1, 512, labels]: the labels take the place of time
        return torch.stack([conv(rows)[0].T for conv in self.convs], 1)

    def forward(self, mixture: Tensor) -> Tensor:
        """mixture [B, labels], intensities 0..1 -> [B, layers, dim], for `Denoiser.forward`."""
        return torch.einsum("bk,kld->bld", mixture, self.table())
