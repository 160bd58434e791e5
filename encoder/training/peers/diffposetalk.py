"""DiffPoseTalk (Sun et al. 2024): diffusion in windows of 100 frames that begin where one ended.

As published: the ten frames before a window and their sound come first (learned ones at the start);
each frame hears its own sound only through a mask of width one; style is 128 numbers of a
transformer over motion that learns by contrast (two pieces of a clip are alike); x0; errors of
vertices, of their velocity, and acceleration kept small; 45 % of the clips come without style,
10 % without style and sound; guidance 1.15, sound first and then style.
Otherwise: no head pose; style learns beside the diffusion instead of before it; DDIM.
"""

import torch
from torch import Tensor, nn
from torch.nn import functional

from encoder.training.geometry import TrainingFace, velocity_loss
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

WINDOW, PAST = 100, 10
STYLE = 128
GUIDANCE = 1.15
NO_SOUND, NO_STYLE = 0.1, 0.45
TEMPERATURE = 0.1
VERTEX_WEIGHT, VELOCITY_WEIGHT, SMOOTH_WEIGHT, CONTRAST_WEIGHT = 0.02, 0.1, 0.001, 0.1  # of mm^2


class StyleEncoder(nn.Module):
    """How somebody moves: x0 [B, T, 256] -> [B, STYLE]."""

    def __init__(self, config: PeerConfig) -> None:
        super().__init__()
        self.config = config
        self.enter = nn.Linear(config.expression_dim, config.dim)
        self.block = PeerBlock(config)
        self.leave = nn.Linear(config.dim, STYLE)

    def forward(self, x0: Tensor) -> Tensor:
        x = self.enter(x0)
        return self.leave(self.block(x, rope_of(x, self.config)).mean(1))


def contrast(one: Tensor, other: Tensor) -> Tensor:
    """NT-Xent of two styles [B, S] of each clip: nearer to each other than to anybody's."""
    both = functional.normalize(torch.cat([one, other]).float(), dim=-1)
    alike = both @ both.T / TEMPERATURE
    alike = alike.masked_fill(torch.eye(len(both), dtype=torch.bool, device=both.device), -1e9)
    partner = torch.arange(len(both), device=both.device).roll(len(one))
    return functional.cross_entropy(alike, partner)


class DiffPoseTalk(PeerNetwork):
    def __init__(self, config: PeerConfig) -> None:
        super().__init__(config)
        self.ears, self.style = WholeClipEars(config), StyleEncoder(config)
        self.tau = TauEmbedding(config.dim)
        self.enter = nn.Linear(config.expression_dim + STYLE, config.dim)
        # attention to one key is that key's value
        self.hear = nn.ModuleList(nn.Linear(config.dim, config.dim) for _ in range(config.layers))
        self.blocks = nn.ModuleList(PeerBlock(config) for _ in range(config.layers))
        self.leave = nn.Linear(config.dim, config.expression_dim)
        self.start_motion = nn.Parameter(torch.zeros(PAST, config.expression_dim))
        self.start_sound = nn.Parameter(torch.zeros(PAST, config.dim))
        self.no_sound = nn.Parameter(torch.zeros(config.dim))
        self.no_style = nn.Parameter(torch.zeros(STYLE))

    def forward(
        self,
        noisy: Tensor,  # [B, T, 256]
        tau: Tensor,  # [B]
        heard: Tensor,  # [B, T, dim]
        style: Tensor,  # [B, STYLE]
        past: tuple[Tensor, Tensor] | None,  # x0 [B, PAST, 256] and what was heard; None: a start
    ) -> Tensor:  # x0 [B, T, 256]
        if past is None:
            start = self.start_motion, self.start_sound
            past = start[0].expand(len(noisy), -1, -1), start[1].expand(len(noisy), -1, -1)
        motion, sound = torch.cat([past[0], noisy], 1), torch.cat([past[1], heard], 1)
        x = self.enter(torch.cat([motion, style[:, None].expand(-1, motion.shape[1], -1)], -1))
        x, rope = x + self.tau(tau)[:, None], rope_of(x, self.config)
        for hear, block in zip(self.hear, self.blocks, strict=True):
            x = block(x + hear(sound), rope)
        return self.leave(x[:, PAST:])

    def losses(self, batch: Batch, face: TrainingFace) -> Losses:
        codes, audio, _, weight = batch
        x0, heard = self.standardise(codes), self.ears(audio)
        half = x0.shape[1] // 2
        learned = contrast(self.style(x0[:, :half]), self.style(x0[:, half:]))
        style, chance = self.style(x0).detach(), torch.rand(len(x0), 1, device=x0.device)
        style = torch.where(chance < NO_SOUND + NO_STYLE, self.no_style, style)
        past = None
        if x0.shape[1] > PAST and torch.rand(()) < 0.5:  # a window after another
            past = x0[:, :PAST], heard[:, :PAST]
            x0, heard, codes, weight = (y[:, PAST:] for y in (x0, heard, codes, weight))
        heard = torch.where(chance[..., None] < NO_SOUND, self.no_sound, heard)
        predicted = self(*self.diffused(x0), heard, style, past)
        guess, truth = face.vertices(self.unstandardise(predicted)), face.vertices(codes)
        parts = {
            "simple": self.error(predicted, x0, weight),
            "vertices": (guess - truth).square().sum(-1).mean(),
            "velocity": velocity_loss(guess, truth, torch.ones_like(face.weights)),
            "smooth": guess.diff(dim=1, n=2).square().sum(-1).mean(),
            "contrast": learned,
        }
        weights = 1.0, VERTEX_WEIGHT, VELOCITY_WEIGHT, SMOOTH_WEIGHT, CONTRAST_WEIGHT
        total = sum(w * p for w, p in zip(weights, parts.values(), strict=True))
        return {**parts, "total": torch.as_tensor(total)}

    @torch.no_grad()
    def codes(self, audio: Tensor, noise: Tensor, truth: Tensor | None = None) -> Tensor:
        """With `truth`, in its style: hypothetical, as that motion is yet to come."""
        heard, nothing = self.ears(audio), self.no_style.expand(len(audio), -1)
        style = None if truth is None else self.style(self.standardise(truth))
        past: tuple[Tensor, Tensor] | None = None
        shown = list[Tensor]()
        for begin in range(0, audio.shape[1], WINDOW):
            sound = heard[:, begin : begin + WINDOW]
            deaf = self.no_sound.expand_as(sound)

            def guided(
                x: Tensor, tau: Tensor, _: bool, sound: Tensor = sound, deaf: Tensor = deaf,
                past: tuple[Tensor, Tensor] | None = past,
            ) -> Tensor:  # fmt: skip
                unled, told = (self(x, tau, y, nothing, past) for y in (deaf, sound))
                result = unled + GUIDANCE * (told - unled)
                if style is None:
                    return result
                return result + GUIDANCE * (self(x, tau, sound, style, past) - told)

            x0 = self.denoise(guided, noise[:, begin : begin + WINDOW])
            past = x0[:, -PAST:], sound[:, -PAST:]
            shown.append(x0)
        return self.unstandardise(torch.cat(shown, 1))
