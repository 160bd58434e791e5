"""The direct path from the sound to the mouth, beside the student's blocks (not in the paper).

From phones' log-odds over a third of a second: what the mouth does, and whether a voice is heard at
all. What the blocks say of the mouth is mixed with it, share by share, and without a voice the lips
rest: phones carry over to voices that nobody learned from, and tell them from rubbing and wind. It
sees no noise and no gaze, and remembers nothing, so that it is causal as it stands; untrained it
changes nothing where a voice is heard.
"""

import torch
from torch import Tensor, nn
from torch.nn import functional

from encoder.denoiser.config import MOUTH, VOICE


class Direct(nn.Module):
    """x0 [B, T, 256] standardised, heard [B, T, D] log-odds -> x0, and how sure it is of a voice
    [B, T, 1], 0..1. Buffers are what of a code is
    the mouth (`MOUTH` numbers, all 0 at rest), and what is shown of it."""

    read: Tensor
    rest: Tensor
    write: Tensor
    share: Tensor

    def __init__(self, direct_dim: int, expression_dim: int, hidden: int) -> None:
        super().__init__()
        self.register_buffer("read", torch.zeros(expression_dim, MOUTH))
        self.register_buffer("rest", torch.zeros(MOUTH))
        self.register_buffer("write", torch.zeros(MOUTH, expression_dim))
        self.register_buffer("share", torch.eye(MOUTH))
        self.listen = nn.Linear(2 * direct_dim, hidden)
        self.think = nn.Linear(hidden, hidden)
        self.move = nn.Linear(hidden, MOUTH)
        self.straight = nn.Linear(2 * direct_dim, MOUTH)
        self.hear = nn.Linear(direct_dim, VOICE)
        self.voice = nn.Linear(VOICE, 1)
        for layer in (self.move, self.straight, self.voice):
            nn.init.zeros_(layer.weight)
            nn.init.zeros_(layer.bias)

    def said(self, seen: Tensor, drop: float = 0.0) -> Tensor:  # [B, T, MOUTH]
        """What log-odds and their sigmoids [B, T, 2 D] say of the mouth. drop: share of hidden
        units that are left out."""
        hidden = functional.dropout(self.listen(seen).relu(), drop)
        hidden = functional.dropout(self.think(hidden).relu(), drop)
        return self.move(hidden) + self.straight(seen)

    def voiced(self, heard: Tensor) -> Tensor:  # [B, T, 1]
        """Log-odds that a voice is heard."""
        return self.voice(self.hear(heard).relu())

    def forward(self, x0: Tensor, heard: Tensor) -> tuple[Tensor, Tensor]:
        own = x0 @ self.read + self.rest
        said = self.said(torch.cat([heard, heard.sigmoid()], -1))
        voice = self.voiced(heard).sigmoid()
        shown = voice * (own @ self.share + said)
        return x0 + (shown - own) @ self.write, voice
