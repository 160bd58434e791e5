"""What the twins of other papers' networks share: how they hear a whole clip, and their blocks.

All see our data, the features of our frozen audio encoder and our code space, standardised as ours
is; their decoder is ours. Where a paper runs wav2vec 2.0 or HuBERT over the whole clip, these have
`WholeClipEars`: blocks of full attention over those features, trained with the rest.
"""

from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor, nn
from torch.nn import functional

from encoder.denoiser.diffusion import Model, Schedule, ddim_taus, sample_ddim
from encoder.denoiser.model import embed_tau
from encoder.nn.attention import Attention, rope_angles, rotate
from encoder.training.geometry import TrainingFace
from encoder.training.streams.whitening import Whitening

PeerName = Literal["talkshow", "audio2photoreal", "diffposetalk"]
Batch = tuple[Tensor, ...]  # codes [B, T, 256], audio [B, T, A], gaze [B, T, 6], weight [B, T]
Rope = tuple[Tensor, Tensor]
Losses = dict[str, Tensor]
SAMPLING_STEPS = 20  # of DDIM; the papers take 500


@dataclass(frozen=True, kw_only=True)
class PeerConfig:
    """Sizes of a twin; the published ones are dim 512 and, of diffusion, 4 or 8 layers."""

    name: PeerName
    audio_dim: int = 512
    expression_dim: int = 256
    dim: int = 256
    ff_dim: int = 512
    heads: int = 4
    ears: int = 2  # blocks over the features of the whole clip
    layers: int = 4  # of the decoder
    num_steps: int = 500  # N
    lips: int = 0  # numbers of the lip regressor: 3 a vertex


class PeerBlock(nn.Module):
    """Full attention, also to a memory if there is one, and a feed-forward; perhaps with FiLM."""

    def __init__(self, config: PeerConfig, *, memory: bool = False, film: bool = False) -> None:
        super().__init__()
        dim, self.heads = config.dim, config.heads
        self.attention = Attention(dim, config.heads, "softmax")
        self.norms = nn.ModuleList(nn.LayerNorm(dim) for _ in range(3 if memory else 2))
        self.ask = nn.Linear(dim, dim) if memory else None
        self.recall = nn.Linear(dim, 2 * dim) if memory else None
        self.answer = nn.Linear(dim, dim) if memory else None
        self.up, self.down = nn.Linear(dim, config.ff_dim), nn.Linear(config.ff_dim, dim)
        self.film = nn.Linear(dim, 2 * dim * len(self.norms)) if film else None

    def forward(
        self,
        x: Tensor,  # [B, T, dim]
        rope: Rope,
        memory: Tensor | None = None,  # [B, T, dim], frame by frame beside x
        lead: Tensor | None = None,  # [B, dim]
    ) -> Tensor:  # [B, T, dim]
        films: list[Tensor | None] = [None] * len(self.norms)
        if self.film is not None and lead is not None:
            films = list(self.film(functional.mish(lead))[:, None].chunk(len(films), -1))
        everything = torch.ones(x.shape[1], x.shape[1], dtype=torch.bool, device=x.device)
        y, _ = self.attention(self.norms[0](x), None, rope, everything)
        x = x + _modulated(y, films[0])
        if memory is not None:
            x = x + _modulated(self._remember(self.norms[1](x), rope, memory), films[1])
        y = self.down(functional.gelu(self.up(self.norms[-1](x))))
        return x + _modulated(y, films[-1])

    def _remember(self, x: Tensor, rope: Rope, memory: Tensor) -> Tensor:
        assert self.ask is not None and self.recall is not None and self.answer is not None
        keys, values = self.recall(memory).chunk(2, -1)
        q, k, v = (
            y.unflatten(-1, (self.heads, -1)).transpose(1, 2) for y in (self.ask(x), keys, values)
        )
        y = functional.scaled_dot_product_attention(rotate(q, *rope), rotate(k, *rope), v)
        return self.answer(y.transpose(1, 2).flatten(2))


def _modulated(y: Tensor, film: Tensor | None) -> Tensor:
    """FiLM: y [B, T, C] scaled and shifted by film [B, 1, 2 C], alike at all frames."""
    if film is None:
        return y
    scale, shift = film.chunk(2, -1)
    return y * (1 + scale) + shift


def rope_of(x: Tensor, config: PeerConfig) -> Rope:
    """Rotary positions of x [B, T, dim]."""
    angles = rope_angles(torch.arange(x.shape[1], device=x.device), config.dim // config.heads)
    return angles[0].float(), angles[1].float()


class WholeClipEars(nn.Module):
    """Features of the frozen encoder, and what else is known of each frame -> what a clip says."""

    mean: Tensor
    matrix: Tensor

    def __init__(self, config: PeerConfig, more: int = 0) -> None:
        super().__init__()
        self.config = config
        self.register_buffer("mean", torch.zeros(config.audio_dim))
        self.register_buffer("matrix", torch.eye(config.audio_dim))
        self.enter = nn.Linear(config.audio_dim + more, config.dim)
        self.blocks = nn.ModuleList(PeerBlock(config) for _ in range(config.ears))
        self.norm = nn.LayerNorm(config.dim)

    def whiten(self, whitening: Whitening) -> None:
        self.mean.copy_(whitening.mean)
        self.matrix.copy_(whitening.matrix)

    def forward(self, audio: Tensor, *more: Tensor) -> Tensor:  # [B, T, A] -> [B, T, dim]
        x = self.enter(torch.cat([(audio - self.mean) @ self.matrix, *more], -1))
        rope = rope_of(x, self.config)
        for block in self.blocks:
            x = block(x, rope)
        return self.norm(x)


class TauEmbedding(nn.Module):
    """The diffusion step as a vector."""

    def __init__(self, dim: int) -> None:
        super().__init__()
        self.dim = dim
        self.think = nn.Sequential(nn.Linear(dim, dim), nn.Mish(), nn.Linear(dim, dim))

    def forward(self, tau: Tensor) -> Tensor:  # [B] int64 -> [B, dim]
        return self.think(embed_tau(tau, self.dim))


class PeerNetwork(nn.Module):
    """A twin: how it learns, and what it shows of a clip. Works on standardised codes inside."""

    expression_mean: Tensor
    expression_std: Tensor
    draws = True  # False: a regression, alike for every noise

    def __init__(self, config: PeerConfig) -> None:
        super().__init__()
        self.config, self.schedule = config, Schedule(config.num_steps)
        self.register_buffer("expression_mean", torch.zeros(config.expression_dim))
        self.register_buffer("expression_std", torch.ones(config.expression_dim))

    def standardise(self, codes: Tensor) -> Tensor:
        return (codes - self.expression_mean) / self.expression_std

    def unstandardise(self, x: Tensor) -> Tensor:
        return x * self.expression_std + self.expression_mean

    def losses(self, batch: Batch, face: TrainingFace) -> Losses:
        """ "total" is what is trained on."""
        raise NotImplementedError

    def codes(self, audio: Tensor, noise: Tensor, truth: Tensor | None = None) -> Tensor:
        """Whole clips: audio [B, T, A], noise [B, T, 256] -> codes [B, T, 256]. truth: codes that
        a hypothetical row takes its style from."""
        raise NotImplementedError

    def error(self, predicted: Tensor, x0: Tensor, weight: Tensor) -> Tensor:
        """Mean squared error [B, T, C] with our weight of each frame [B, T]."""
        return ((predicted - x0).square().mean(-1) * weight).mean()

    def diffused(self, x0: Tensor) -> tuple[Tensor, Tensor]:
        """x0 [B, T, C] -> noisy ones at tau [B], uniform over 1..N."""
        tau = torch.randint(1, self.config.num_steps + 1, (len(x0),), device=x0.device)
        return self.schedule.q_sample(x0, tau, torch.randn_like(x0)), tau

    def denoise(self, model: Model, noise: Tensor) -> Tensor:
        """DDIM from noise [B, T, C] down -> x0."""
        taus = ddim_taus(self.config.num_steps, SAMPLING_STEPS)
        return sample_ddim(model, noise, taus, schedule=self.schedule)
