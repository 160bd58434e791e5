"""How far the lips are apart as a straight line of the phones heard.

Beside the network of the direct path, which learns most from the one talker of many clips. A line
over few principal components learns alike from all: each talker of few clips counts as much as
another. The two err differently; between them, lips of talkers never seen are followed better.
"""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from encoder.denoiser.config import MOUTH
from encoder.denoiser.direct import Direct
from encoder.training.streams.pieces import SpokenPieces

COMPONENTS = 90
RIDGE = 3e-3  # of the components' mean variance


@dataclass(frozen=True)
class OpeningLine:
    """Takes a share of the lips' opening from the line, which is in mm."""

    weight: Tensor  # [2 D] of what is seen: log-odds and their sigmoids, standardised
    offset: Tensor  # []
    way: Tensor  # [MOUTH]: one mm of the line, in its share
    kept: Tensor  # [MOUTH, MOUTH]: what stays of the network's mouth

    @staticmethod
    def of(
        pieces: SpokenPieces, scale: tuple[Tensor, Tensor], without: tuple[str, ...], share: float
    ) -> "OpeningLine":
        """Fitted to the plain clips of `pieces`; without any, the line has no share."""
        frames, mouth = pieces.frames, pieces.mouth
        rows = frames.plain & ~np.isin(frames.voice, without)
        way = share * mouth.ways(torch.from_numpy(pieces.truth))[0] * float(rows.any())
        heard = torch.from_numpy(frames.heard[rows].astype(np.float32))
        seen = (torch.cat([heard, heard.sigmoid()], -1) - scale[0]) / scale[1]
        opening = mouth.gap(torch.from_numpy(pieces.truth[rows]))
        weight, offset = fit_line(seen, opening, frames.voice[rows])
        return OpeningLine(weight, offset, way, torch.eye(MOUTH) - mouth.lips[:, :1] * way)

    def beside(self, said: Tensor, seen: Tensor) -> Tensor:
        """The network's mouth [..., MOUTH], with the line's share."""
        return said @ self.kept + (seen @ self.weight + self.offset)[..., None] * self.way

    @torch.no_grad()
    def fold(self, direct: Direct) -> None:
        """In place: a direct path that says both, of what is seen."""
        for layer in (direct.move, direct.straight):
            layer.weight.copy_(self.kept.T @ layer.weight)
            layer.bias.copy_(self.kept.T @ layer.bias)
        direct.straight.weight.add_(self.way[:, None] * self.weight)
        direct.straight.bias.add_(self.way * self.offset)


def fit_line(seen: Tensor, opening: Tensor, talkers: np.ndarray) -> tuple[Tensor, Tensor]:
    """seen [N, C], opening [N] mm, talkers [N] str -> weights [C] and offset [] of the line."""
    weight = torch.zeros(len(seen), dtype=torch.float64)
    for name in np.unique(talkers):
        rows = torch.from_numpy(talkers == name)
        weight[rows] = 1 / rows.sum()
    weight /= weight.sum().clamp(min=1)
    middle, height = weight @ seen.double(), weight @ opening.double()
    apart = (seen - middle) * weight.sqrt()[:, None]
    variance, ways = torch.linalg.eigh(apart.T @ apart)
    variance, ways = variance[-COMPONENTS:], ways[:, -COMPONENTS:]
    drawn = ways.T @ (apart.T @ ((opening - height) * weight.sqrt()))
    line = ways @ (drawn / (variance + RIDGE * variance.mean()).clamp(min=1e-9))
    return line.float(), (height - middle @ line).float()
