"""How far the lips are apart and how wide they are, as straight lines of the phones heard.

Beside the network of the direct path, which learns most from the one talker of many clips. A line
over principal components learns alike from all: each talker counts as much as another, those of
few clips, those of many and made speech. The two err differently; between them, lips of talkers
never seen are followed better.
"""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from encoder.denoiser.config import MOUTH
from encoder.denoiser.direct import Direct
from encoder.training.streams.pieces import SpokenPieces
from encoder.training.streams.spoken import REST, SpokenFrames

COMPONENTS = (90, 500)  # of the opening, of the width; at most as many as there are inputs
RIDGES = (3e-3, 3e-2)  # of the components' mean variance
MOST = 2000  # frames of a voice that has no plain clips


@dataclass(frozen=True)
class LipLines:
    """Takes a share of the lips' opening and width from lines, which are in mm."""

    weight: Tensor  # [2 D, 2] of what is seen: log-odds and their sigmoids, standardised
    offset: Tensor  # [2]
    ways: Tensor  # [2, MOUTH]: one mm of each line, in its share
    kept: Tensor  # [MOUTH, MOUTH]: what stays of the network's mouth

    @staticmethod
    def of(
        pieces: SpokenPieces,
        scale: tuple[Tensor, Tensor],
        shares: tuple[float, float],
    ) -> "LipLines":
        """Fitted to the plain clips of `pieces` and some frames of each other voice; without plain
        clips the lines have no share."""
        frames, mouth = pieces.frames, pieces.mouth
        rows = fitted(frames)
        there = torch.tensor(shares)[:, None] * float(len(rows) > 0)
        ways = there * mouth.ways(torch.from_numpy(pieces.truth))
        heard = torch.from_numpy(frames.heard[rows].astype(np.float32))
        seen = (torch.cat([heard, heard.sigmoid()], -1) - scale[0]) / scale[1]
        spans = mouth.spans(torch.from_numpy(pieces.truth[rows]))
        weight, offset = fit_lines(seen, spans, frames.voice[rows])
        return LipLines(weight, offset, ways, torch.eye(MOUTH) - mouth.lips @ ways)

    def beside(self, said: Tensor, seen: Tensor) -> Tensor:
        """The network's mouth [..., MOUTH], with the lines' share."""
        return said @ self.kept + (seen @ self.weight + self.offset) @ self.ways

    @torch.no_grad()
    def fold(self, direct: Direct) -> None:
        """In place: a direct path that says both, of what is seen."""
        for layer in (direct.move, direct.straight):
            layer.weight.copy_(self.kept.T @ layer.weight)
            layer.bias.copy_(self.kept.T @ layer.bias)
        direct.straight.weight.add_((self.weight @ self.ways).T)
        direct.straight.bias.add_(self.offset @ self.ways)


def fitted(frames: SpokenFrames) -> np.ndarray:
    """Rows of the frames that lines are fitted to."""
    plain = np.flatnonzero(frames.plain)
    if not len(plain):
        return plain
    rows = [plain]
    known = (*np.unique(frames.voice[frames.plain]), REST)
    for voice in np.setdiff1d(frames.voice, known):
        others = np.flatnonzero(frames.voice == voice)
        rows.append(others[:: max(len(others) // MOST, 1)])
    return np.concatenate(rows)


def fit_lines(seen: Tensor, spans: Tensor, talkers: np.ndarray) -> tuple[Tensor, Tensor]:
    """seen [N, C], spans [N, 2] mm, talkers [N] str -> weights [C, 2] and offsets [2] of lines."""
    weight = torch.zeros(len(seen), dtype=torch.float64)
    for name in np.unique(talkers):
        rows = torch.from_numpy(talkers == name)
        weight[rows] = 1 / rows.sum()
    weight /= weight.sum().clamp(min=1)
    middle, mean = weight @ seen.double(), weight @ spans.double()
    apart = (seen - middle) * weight.sqrt()[:, None]
    variance, ways = torch.linalg.eigh(apart.T @ apart)
    drawn = ways.T @ (apart.T @ ((spans - mean) * weight.sqrt()[:, None]))
    lines = torch.zeros_like(drawn)
    for span, (most, ridge) in enumerate(zip(COMPONENTS, RIDGES, strict=True)):
        count = min(most, seen.shape[1])
        least = ridge * variance[-count:].mean()
        share = drawn[-count:, span] / (variance[-count:] + least).clamp(min=1e-9)
        lines[:, span] = ways[:, -count:] @ share
    return lines.float(), (mean - middle @ lines).float()
