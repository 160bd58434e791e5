"""The contact head: it closes lips that the student leaves slightly open, and parts those that it
shuts where nothing asks for it (not in the paper).

Where p, b or m is likely but not sure, one step of denoising brings the lips near each other and
stops a millimetre short. The head sees how far they are open and what is heard in the same frame,
and moves them together or apart, along the one direction of the code that does nothing else; lips
that are far apart it leaves there. Where none of the three is heard lips that talk stay
`PARTED_MM` apart: in the silence of a t the student shuts them, and opens them only when the vowel
behind it sounds. It remembers nothing, so that it is causal as it stands; untrained it changes
nothing.
"""

import torch
from torch import Tensor, nn

from encoder.denoiser.config import ACTS_MM, KNOTS_MM, LIPS, PARTED_MM, UNHEARD


class Contact(nn.Module):
    """x0 [B, T, 256] standardised, audio [B, T, A] -> x0. Buffers are what a code is in mm."""

    gap: Tensor
    rest: Tensor
    shut: Tensor
    closures: Tensor
    knots: Tensor

    def __init__(self, expression_dim: int, audio_dim: int, hidden: int, reach_mm: float) -> None:
        super().__init__()
        self.reach_mm = reach_mm
        self.register_buffer("gap", torch.zeros(expression_dim))  # mm that a unit of x0 opens
        self.register_buffer("rest", torch.zeros(()))  # mm at x0 = 0, against lips at rest
        self.register_buffer("shut", torch.zeros(expression_dim))  # of x0, for one mm
        # of audio: log-odds of p, b, m; all 0 where it does not tell
        self.register_buffer("closures", torch.zeros(LIPS, audio_dim))
        self.register_buffer("knots", torch.tensor(KNOTS_MM), persistent=False)
        self.listen = nn.Linear(1 + len(KNOTS_MM) + audio_dim, hidden)
        self.move = nn.Linear(hidden, 1)
        nn.init.zeros_(self.move.weight)
        nn.init.zeros_(self.move.bias)

    def gap_mm(self, x0: Tensor) -> Tensor:  # [B, T, 1]
        """How far apart the lips are."""
        return (x0 @ self.gap + self.rest)[..., None]

    def wanted_mm(self, gap: Tensor, audio: Tensor) -> Tensor:  # [B, T, 1] mm, [B, T, A]
        """How much wider the trained head would make the gap, however far apart the lips are."""
        seen = torch.cat([gap, (self.knots - gap).relu(), audio], -1)
        return self.reach_mm * self.move(self.listen(seen).relu()).tanh()

    def moved_mm(self, gap: Tensor, audio: Tensor) -> Tensor:  # [B, T, 1] mm, [B, T, A]
        """How much wider it makes the gap: lips that are far apart it leaves there."""
        return _share(gap, *ACTS_MM) * self.wanted_mm(gap, audio)

    def parted_mm(self, gap: Tensor, audio: Tensor) -> Tensor:  # [B, T, 1] mm, [B, T, A]
        """How much wider the gap becomes where neither p, b nor m is heard."""
        heard = (audio @ self.closures.T).amax(-1, keepdim=True)
        return (PARTED_MM - gap).relu() * _share(heard, *UNHEARD)

    def forward(self, x0: Tensor, audio: Tensor, voice: Tensor | float = 1.0) -> Tensor:
        """voice [B, T, 1]: how sure it is that one is heard; without, lips stay where they are."""
        gap = self.gap_mm(x0)
        moved = voice * self.moved_mm(gap, audio)
        return x0 + (moved + voice * self.parted_mm(gap + moved, audio)) * self.shut


def _share(x: Tensor, low: float, high: float) -> Tensor:
    """1 up to low, 0 from high on."""
    return ((high - x) / (high - low)).clamp(0, 1)
