"""Audio2Photoreal's face (Ng et al. 2024): diffusion over a clip that is shown regressed lips.

As published: a regressor from sound to lip vertices; sound and lips through two blocks; a decoder
with FiLM and attention to them, x0, a cosine schedule, a tenth of the clips without sound.
Otherwise: one voice, as in the paper's table; the regressor learns beside the diffusion, from the
same clips, and feels nothing of its error; guidance is 2, theirs 10, and DDIM takes fewer steps.
"""

import torch
from torch import Tensor, nn

from encoder.training.geometry import TrainingFace
from encoder.training.peers.parts import (
    Batch,
    Losses,
    PeerBlock,
    PeerConfig,
    PeerNetwork,
    TauEmbedding,
    WholeClipEars,
    rope_of,
)

DROP = 0.1
GUIDANCE = 2.0
LIPS_WEIGHT = 0.1  # per mm^2


def lip_vertices(face: TrainingFace, codes: Tensor) -> Tensor:
    """Those that weigh most, of codes [B, T, 256] -> [B, T, 3 n] mm."""
    return face.vertices(codes)[..., face.weights == face.weights.max(), :].flatten(2)


class Audio2Photoreal(PeerNetwork):
    def __init__(self, config: PeerConfig) -> None:
        super().__init__(config)
        self.lip_ears, self.lips = WholeClipEars(config), nn.Linear(config.dim, config.lips)
        self.ears = WholeClipEars(config, config.lips)
        self.nothing = nn.Parameter(torch.zeros(config.dim))
        self.tau = TauEmbedding(config.dim)
        self.pooled = nn.Linear(config.dim, config.dim)
        self.enter = nn.Linear(config.expression_dim, config.dim)
        self.blocks = nn.ModuleList(
            PeerBlock(config, memory=True, film=True) for _ in range(config.layers)
        )
        self.leave = nn.Linear(config.dim, config.expression_dim)

    def regressed(self, audio: Tensor) -> Tensor:  # [B, T, A] -> lips [B, T, 3 n] mm
        return self.lips(self.lip_ears(audio))

    def hear(self, audio: Tensor, lips: Tensor) -> Tensor:  # -> [B, T, dim]
        return self.ears(audio, lips)

    def forward(self, noisy: Tensor, tau: Tensor, heard: Tensor) -> Tensor:
        """noisy [B, T, 256], tau [B], heard [B, T, dim] -> x0 [B, T, 256]."""
        x = self.enter(noisy)
        rope, lead = rope_of(x, self.config), self.tau(tau) + self.pooled(heard.mean(1))
        for block in self.blocks:
            x = block(x, rope, heard, lead)
        return self.leave(x)

    def losses(self, batch: Batch, face: TrainingFace) -> Losses:
        codes, audio, _, weight = batch
        x0, lips = self.standardise(codes), self.regressed(audio)
        regression = (lips - lip_vertices(face, codes)).square().mean()
        heard = self.hear(audio, lips.detach())
        keep = torch.rand(len(x0), device=x0.device) >= DROP
        heard = torch.where(keep[:, None, None], heard, self.nothing)
        simple = self.error(self(*self.diffused(x0), heard), x0, weight)
        return {"simple": simple, "lips": regression, "total": simple + LIPS_WEIGHT * regression}

    @torch.no_grad()
    def codes(self, audio: Tensor, noise: Tensor, truth: Tensor | None = None) -> Tensor:
        heard = self.hear(audio, self.regressed(audio))
        nothing = self.nothing.expand_as(heard)

        def guided(x: Tensor, tau: Tensor, _: bool) -> Tensor:
            unled = self(x, tau, nothing)
            return unled + GUIDANCE * (self(x, tau, heard) - unled)

        return self.unstandardise(self.denoise(guided, noise))
