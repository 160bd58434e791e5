"""The direct path from the sound to the mouth, beside the student's blocks (not in the paper).

Reads the log-odds of phones over the last third of a second. It predicts the mouth, which is mixed
with the prediction of the blocks, and the probability that a voice is heard, without which the lips
rest. Phones carry over to talkers that the training never heard, and tell a voice from rubbing and
wind. The path sees neither noise nor gaze and holds no state, so that it is causal by construction;
untrained it adds nothing to the blocks.
"""

import torch
from torch import Tensor, nn
from torch.nn import functional

from encoder.denoiser.config import MOUTH, VOICE


class Direct(nn.Module):
    """x0 [B, T, 256] standardised, heard [B, T, D] log-odds -> x0 [B, T, 256], and the probability
    of a voice [B, T, 1].

    Buffers: `read` and `rest` take the mouth out of a code (`MOUTH` numbers, all 0 at rest),
    `share` is how much of the blocks' mouth is kept, `write` puts a mouth into a code.
    """

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
        """The mouth, from log-odds and their sigmoids [B, T, 2 D]. drop: dropout probability of
        the hidden units."""
        hidden = functional.dropout(self.listen(seen).relu(), drop)
        hidden = functional.dropout(self.think(hidden).relu(), drop)
        return self.move(hidden) + self.straight(seen)

    def voiced(self, heard: Tensor) -> Tensor:  # [B, T, 1]
        """Log-odds of a voice, from those of phones [B, T, D]."""
        return self.voice(self.hear(heard).relu())

    def forward(self, x0: Tensor, heard: Tensor) -> tuple[Tensor, Tensor]:
        own = x0 @ self.read + self.rest
        said = self.said(torch.cat([heard, heard.sigmoid()], -1))
        voice = self.voiced(heard).sigmoid()
        shown = voice * (own @ self.share + said)
        return x0 + (shown - own) @ self.write, voice
