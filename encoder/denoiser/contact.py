"""The contact head: it closes lips that the student leaves slightly open (not in the paper).

Where p, b or m is likely but not sure, one step of denoising brings the lips near each other and
stops a millimetre short. The head sees how far they are open and what is heard in the same frame,
and moves them together or apart, along the one direction of the code that does nothing else; lips
that are far apart it leaves there. It remembers nothing, so that it is causal as it stands;
untrained it changes nothing.
"""

import torch
from torch import Tensor, nn

from encoder.denoiser.config import ACTS_MM, KNOTS_MM


class Contact(nn.Module):
    """x0 [B, T, 256] standardised, audio [B, T, A] -> x0. Buffers are what a code is in mm."""

    gap: Tensor
    rest: Tensor
    shut: Tensor
    knots: Tensor

    def __init__(self, expression_dim: int, audio_dim: int, hidden: int, reach_mm: float) -> None:
        super().__init__()
        self.reach_mm = reach_mm
        self.register_buffer("gap", torch.zeros(expression_dim))  # mm that a unit of x0 opens
        self.register_buffer("rest", torch.zeros(()))  # mm at x0 = 0, against lips at rest
        self.register_buffer("shut", torch.zeros(expression_dim))  # of x0, for one mm
        self.register_buffer("knots", torch.tensor(KNOTS_MM), persistent=False)
        self.listen = nn.Linear(1 + len(KNOTS_MM) + audio_dim, hidden)
        self.move = nn.Linear(hidden, 1)
        nn.init.zeros_(self.move.weight)
        nn.init.zeros_(self.move.bias)

    def moved_mm(self, x0: Tensor, audio: Tensor) -> Tensor:  # [B, T, 1]
        """How much wider the head makes the gap."""
        gap = (x0 @ self.gap + self.rest)[..., None]
        seen = torch.cat([gap, (self.knots - gap).relu(), audio], -1)
        low, high = ACTS_MM
        near = ((high - gap) / (high - low)).clamp(0, 1)
        return self.reach_mm * near * self.move(self.listen(seen).relu()).tanh()

    def forward(self, x0: Tensor, audio: Tensor, voice: Tensor | float = 1.0) -> Tensor:
        """voice [B, T, 1]: how sure it is that one is heard; without, lips stay where they are."""
        return x0 + voice * self.moved_mm(x0, audio) * self.shut
