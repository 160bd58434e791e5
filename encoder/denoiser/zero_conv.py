"""Zero convolutions: what an emotion does between the blocks of the frozen denoiser (paper 5.1).

y' = (1 + S(c)) y + Z(c): 1x1 convolutions of the emotion's 512 numbers c before every Transformer
block, before the output and after it. All start at zero, so an untrained one changes nothing. c
does not change over time, and so each is one vector: the live path runs no convolution.

Unlike the paper: there is one after the output, whose frozen layer has hardly seen a smile (what
its columns do not hold nothing before it can reach), and S, for what is added to every frame alike
cannot raise a lip in speech and leave it where the lips shut.
"""

import torch
from torch import Tensor, nn

from encoder.denoiser.config import OUTPUT_GAIN, ZeroConvConfig


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
        self.shifts, self.scales = (
            nn.ModuleList(nn.Conv1d(config.embedding, size, 1) for size in config.places)
            for _ in range(2)
        )
        for conv in (*self.shifts, *self.scales):
            nn.init.zeros_(conv.weight)  # type: ignore[arg-type]
            nn.init.zeros_(conv.bias)  # type: ignore[arg-type]

    def table(self) -> Tensor:
        """What each label does at full intensity: [labels, width], a shift and a scale a place.

        Twin: `live.emotion_table`.
        """
        rows = self.embeddings.T[None]  # [1, 512, labels]: the labels take the place of time
        shifts = [conv(rows)[0].T for conv in self.shifts]
        scales = [conv(rows)[0].T for conv in self.scales]
        shifts[-1] = OUTPUT_GAIN * shifts[-1]
        return torch.cat([x for pair in zip(shifts, scales, strict=True) for x in pair], 1)

    def forward(self, mixture: Tensor) -> Tensor:
        """mixture [B, labels], intensities 0..1 -> [B, width], for `Denoiser.forward`."""
        return mixture @ self.table()
