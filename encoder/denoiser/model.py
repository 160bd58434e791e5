"""The online Transformer F: noisy expression codes, tau, audio and gaze -> clean codes x0.

Paper section 4.1 and appendix "Online Transformer Architecture": conditions are concatenated with
the noisy codes, tau enters through AdaLN, frame t attends to frames t - w .. t, positions are RoPE.
`step` keeps the keys and values of the last w frames: at a fixed tau this is the paper's
outpainting, exactly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from math import log

import torch
from torch import Tensor, nn
from torch.nn import functional

from encoder.denoiser.config import HEAD, DenoiserConfig
from encoder.denoiser.contact import Contact
from encoder.denoiser.direct import Direct
from encoder.nn.attention import Attention, rope_angles
from encoder.nn.streaming import State


def embed_tau(tau: Tensor, dim: int) -> Tensor:  # [B] -> [B, dim] sines and cosines
    half = dim // 2
    rate = torch.exp(torch.arange(half, device=tau.device) * (-log(10_000.0) / half))
    angles = tau[:, None].float() * rate
    return torch.cat([angles.cos(), angles.sin()], -1)


class DenoiserBlock(nn.Module):
    """Attention and feed-forward, both modulated by tau (AdaLN with zero-initialised gates)."""

    def __init__(self, config: DenoiserConfig) -> None:
        super().__init__()
        self.attention = Attention(config.dim, config.heads, config.attention)
        self.up = nn.Linear(config.dim, config.ff_dim)
        self.down = nn.Linear(config.ff_dim, config.dim)
        self.modulate = nn.Linear(config.dim, 6 * config.dim)
        nn.init.zeros_(self.modulate.weight)
        nn.init.zeros_(self.modulate.bias)

    def forward(
        self, x: Tensor, tau: Tensor, past: tuple[Tensor, Tensor] | None,
        rope: tuple[Tensor, Tensor], mask: Tensor,
    ) -> tuple[Tensor, tuple[Tensor, Tensor]]:  # fmt: skip
        dim = x.shape[-1:]
        shift1, scale1, gate1, shift2, scale2, gate2 = self.modulate(tau)[:, None].chunk(6, -1)
        y = functional.layer_norm(x, dim) * (1 + scale1) + shift1
        y, kept = self.attention(y, past, rope, mask)
        x = x + gate1 * y
        y = functional.layer_norm(x, dim) * (1 + scale2) + shift2
        return x + gate2 * self.down(functional.gelu(self.up(y), approximate="tanh")), kept


def _with(x: Tensor, emotion: Tensor | None) -> Tensor:
    """x [B, T, C] shifted and scaled by an emotion [B, 1, 2 C], alike at all frames."""
    if emotion is None:
        return x
    shift, scale = emotion.chunk(2, -1)
    return x * (1 + scale) + shift


class Denoiser(nn.Module):
    """Works in standardised code space; `standardise` and `unstandardise` cross the border."""

    block_size = 1
    ratio = Fraction(1)
    delay = 0
    stale = ("keys", "values")  # entries of a new state that nothing reads before `step` fills them
    expression_mean: Tensor
    expression_std: Tensor

    def __init__(self, config: DenoiserConfig) -> None:
        super().__init__()
        self.config = config
        self.register_buffer("expression_mean", torch.zeros(config.expression_dim))
        self.register_buffer("expression_std", torch.ones(config.expression_dim))
        self.null_audio = nn.Parameter(torch.zeros(config.audio_dim))
        self.null_condition = nn.Parameter(torch.zeros(config.condition_dim))
        self.input = nn.Linear(sum(config.input_dims), config.dim)
        self.tau = nn.Sequential(
            nn.Linear(config.dim, config.dim),
            nn.SiLU(),
            nn.Linear(config.dim, config.dim),
            nn.SiLU(),
        )
        self.blocks = nn.ModuleList(DenoiserBlock(config) for _ in range(config.layers))
        self.norm = nn.LayerNorm(config.dim)
        self.output = nn.Linear(config.dim, config.expression_dim)
        self.direct: Direct | None = None
        if config.direct_dim:
            self.direct = Direct(config.direct_dim, config.expression_dim, config.direct)
        self.contact: Contact | None = None
        if config.contact:
            self.contact = Contact(
                config.expression_dim, config.contact_dim, config.contact, config.reach_mm
            )

    def standardise(self, x: Tensor) -> Tensor:
        return (x - self.expression_mean) / self.expression_std

    def unstandardise(self, x: Tensor) -> Tensor:
        return x * self.expression_std + self.expression_mean

    def _inputs(
        self, noisy: Tensor, audio: Tensor, condition: Tensor,
        keep_audio: Tensor | None, keep_condition: Tensor | None,
    ) -> tuple[Tensor, Tensor]:  # fmt: skip
        """Input of the first block, and the audio with the null where it is not kept."""
        if keep_audio is not None:
            audio = torch.where(keep_audio[:, None, None], audio, self.null_audio)
        if keep_condition is not None:
            condition = torch.where(keep_condition[:, None, None], condition, self.null_condition)
        heard = audio[..., : self.config.input_dims[1]]
        return self.input(torch.cat([noisy, heard, condition], -1)), audio

    def _tau(self, tau: Tensor) -> Tensor:  # [B] -> [B, dim]
        return self.tau(embed_tau(tau, self.config.dim).to(self.output.weight.dtype))

    def _rope(self, positions: Tensor) -> tuple[Tensor, Tensor]:
        cos, sin = rope_angles(positions, self.config.dim // self.config.heads)
        return cos.to(self.output.weight.dtype), sin.to(self.output.weight.dtype)

    def _places(self, emotion: Tensor | None) -> Sequence[Tensor | None]:
        """Shift and scale at each of config.places."""
        sizes = [2 * size for size in self.config.places]
        return [None] * len(sizes) if emotion is None else emotion[:, None].split(sizes, -1)

    def _output(self, x: Tensor, audio: Tensor, places: Sequence[Tensor | None]) -> Tensor:
        x0 = self.output(self.norm(_with(x, places[-2])))  # x [B, T, dim]
        voice: Tensor | float = 1.0
        if self.direct is not None:
            x0, voice = self.direct(x0, audio[..., -self.config.direct_dim :])
        x0 = _with(x0, places[-1])
        if self.contact is None:
            return x0
        return self.contact(x0, audio[..., -self.config.contact_dim :], voice)

    def forward(
        self,
        noisy: Tensor,  # [B, T, 256] standardised codes with noise
        tau: Tensor,  # [B] int64, 0..N
        audio: Tensor,  # [B, T, A]
        condition: Tensor,  # [B, T, condition_dim]
        keep_audio: Tensor | None = None,  # [B] bool; False: the learned null
        keep_condition: Tensor | None = None,  # [B] bool
        emotion: Tensor | None = None,  # [B, 2 sum(places)], see zero_conv.py
    ) -> Tensor:  # x0 [B, T, 256]
        x, audio = self._inputs(noisy, audio, condition, keep_audio, keep_condition)
        positions = torch.arange(x.shape[1], device=x.device)
        lag = positions[:, None] - positions[None]
        mask = (lag >= 0) & (lag <= self.config.window) | (not self.config.causal)
        rope, embedded, places = self._rope(positions), self._tau(tau), self._places(emotion)
        for i, block in enumerate(self.blocks):
            x, _ = block(_with(x, places[i]), embedded, None, rope, mask)
        return self._output(x, audio, places)

    def init_state(self, batch: int) -> State:
        """keys, values: one [B, H, w, D] a layer, stale until `frame` (int64 []) has reached w."""
        c, like = self.config, self.output.weight
        assert c.causal, "an offline model has no stream"
        shape = (c.layers, batch, c.heads, c.window, c.dim // c.heads)
        frame = torch.zeros((), dtype=torch.int64)
        return {"keys": like.new_zeros(shape), "values": like.new_zeros(shape), "frame": frame}

    def step(
        self, noisy: Tensor, tau: Tensor, audio: Tensor, condition: Tensor, state: State,
        keep_audio: Tensor | None = None, keep_condition: Tensor | None = None,
        emotion: Tensor | None = None,
    ) -> tuple[Tensor, State]:  # fmt: skip
        """Any number of new frames T, shapes as in `forward`; tau stays the same in a stream."""
        window = self.config.window
        x, audio = self._inputs(noisy, audio, condition, keep_audio, keep_condition)
        time, frame = x.shape[1], state["frame"].to(x.device)
        positions = frame + torch.arange(-window, time, device=x.device)
        lag = positions[window:, None] - positions[None]
        mask = (lag >= 0) & (lag <= window) & (positions >= 0)
        fresh = (positions[:window] >= 0)[:, None]  # a stale slot may hold anything, even NaN
        keys, values = torch.where(fresh, state["keys"], 0), torch.where(fresh, state["values"], 0)
        rope, embedded, places = self._rope(positions), self._tau(tau), self._places(emotion)
        kept = []
        for i, block in enumerate(self.blocks):
            x = _with(x, places[i])
            x, (k, v) = block(x, embedded, (keys[i], values[i]), rope, mask)
            kept.append((k[:, :, time:], v[:, :, time:]))
        state = {
            "keys": torch.stack([k for k, _ in kept]),
            "values": torch.stack([v for _, v in kept]),
            "frame": state["frame"] + time,
        }
        return self._output(x, audio, places), state


def headless(student: Denoiser) -> Denoiser:
    """A copy without the contact head, which is trained behind everything else."""
    plain = Denoiser(replace(student.config, contact=0))
    tensors = student.state_dict().items()
    plain.load_state_dict({name: value for name, value in tensors if not name.startswith(HEAD)})
    return plain
