"""The direct path from the sound to the mouth, beside the student's blocks (not in the paper).

A linear map of phones' log-odds over a third of a second, and of the odds' sigmoids: so shallow a
path carries over to voices that nobody learned from, where a deep one also learns whose voice it
is. It sees no noise and no gaze, and remembers nothing.
"""

import torch
from torch import Tensor, nn


class Direct(nn.Module):
    """heard [B, T, D] log-odds -> what is added to x0 [B, T, 256], standardised."""

    def __init__(self, direct_dim: int, expression_dim: int) -> None:
        super().__init__()
        self.move = nn.Linear(2 * direct_dim, expression_dim)
        nn.init.zeros_(self.move.weight)
        nn.init.zeros_(self.move.bias)

    def forward(self, heard: Tensor) -> Tensor:
        return self.move(torch.cat([heard, heard.sigmoid()], -1))
