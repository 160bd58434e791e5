"""Sizes of the denoiser, and the names and shapes of its weights; needs no torch.

Shared by the torch module (model.py) and its live twin (graph.py).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from encoder.types import Condition
from sensors.types import InputError

# The contact head (contact.py): lip gaps at which its response may change slope
KNOTS_MM = (0.0, 0.3, 0.7, 1.2, 1.7, 2.7, 3.7)
# It acts wholly up to the first gap and not from the second on: lips far apart are meant to be
ACTS_MM = (4.0, 6.0)
# How far apart lips that talk stay where p, b and m are not heard: wholly up to the first log-odds
# and no more from the second on. Of eight talkers left out, open vowels shut of 184 | share of p,
# b, m inside words shut: -2.4 to -1.8 7 | .921; -2.0 to -1.5 6 | .916; these 5 | .911; -1.6 to -1.1
# 4 | .872
PARTED_MM = 1.2
UNHEARD = (-1.8, -1.3)
LIPS = 3  # phones that shut them: p, b, m
MAX_REACH_MM = 20.0
HEAD = "contact."  # prefix of its tensors' names
# The direct path (direct.py): numbers that a mouth is, and hidden units of what hears voices.
MOUTH = 29
VOICE = 32
# The zero convolutions of emotions (zero_conv.py)
EMBEDDING = 512  # as in the paper (CLIP)
OUTPUT_GAIN = 10.0  # a smile lies 15 standard deviations away from the codes of neutral speech


@dataclass(frozen=True, kw_only=True)
class DenoiserConfig:
    expression_dim: int = 256
    condition: Condition = "gaze"
    condition_dim: int = 6  # gaze: 2 unit vectors
    audio_dim: int = 512
    layers: int = 4
    dim: int = 256
    ff_dim: int = 512
    heads: int = 4
    window: int = 25  # w: a frame sees itself and w frames before it
    causal: bool = True  # False: every frame sees the whole clip (the offline upper bound)
    attention: Literal["softmax", "linear"] = "softmax"
    num_steps: int = 200  # N
    # size of the last part of the audio features, for the direct path only (not for the blocks)
    direct_dim: int = 0
    direct: int = 0  # hidden units of the direct path
    contact: int = 0  # hidden units of the student's contact head; 0: none
    reach_mm: float = 6.0  # the largest change of the lips' gap that the head makes

    def __post_init__(self) -> None:
        reach: object = self.reach_mm  # of a card: anything
        if type(reach) not in (int, float) or not 0 < self.reach_mm <= MAX_REACH_MM:
            raise InputError(
                f"DenoiserConfig: expected a reach_mm above 0 and up to {MAX_REACH_MM:g}, got "
                f"{reach!r}; restore the student's card or train the head anew"
            )

    @property
    def input_dims(self) -> tuple[int, int, int]:
        """Inputs of the blocks: noisy code, audio features less the direct path's, condition."""
        return self.expression_dim, self.audio_dim - self.direct_dim, self.condition_dim

    @property
    def contact_dim(self) -> int:
        """How many numbers at the end of the audio features the contact head hears."""
        return self.direct_dim or self.audio_dim

    @property
    def places(self) -> tuple[int, ...]:
        """Widths where an emotion acts: before each block, before the output and after it."""
        return (*[self.dim] * (self.layers + 1), self.expression_dim)


@dataclass(frozen=True, kw_only=True)
class ZeroConvConfig:
    labels: tuple[str, ...]
    places: tuple[int, ...]  # of DenoiserConfig
    embedding: int = EMBEDDING


PRESETS = {
    "debug": DenoiserConfig(layers=2, dim=64, ff_dim=128),
    "default": DenoiserConfig(),
    "paper": DenoiserConfig(layers=8, dim=512, ff_dim=1024),
}


def weight_shapes(config: DenoiserConfig) -> dict[str, tuple[int, ...]]:
    """Names and shapes of `Denoiser`'s tensors."""
    dim, code = config.dim, config.expression_dim
    shapes: dict[str, tuple[int, ...]] = {
        "expression_mean": (code,),
        "expression_std": (code,),
        "null_audio": (config.audio_dim,),
        "null_condition": (config.condition_dim,),
    }

    def linear(name: str, inputs: int, outputs: int) -> None:
        shapes[f"{name}.weight"], shapes[f"{name}.bias"] = (outputs, inputs), (outputs,)

    linear("input", sum(config.input_dims), dim)
    linear("tau.0", dim, dim)
    linear("tau.2", dim, dim)
    for i in range(config.layers):
        linear(f"blocks.{i}.attention.qkv", dim, 3 * dim)
        linear(f"blocks.{i}.attention.out", dim, dim)
        linear(f"blocks.{i}.up", dim, config.ff_dim)
        linear(f"blocks.{i}.down", config.ff_dim, dim)
        linear(f"blocks.{i}.modulate", dim, 6 * dim)
    shapes |= {"norm.weight": (dim,), "norm.bias": (dim,)}
    linear("output", dim, code)
    if config.direct_dim:
        shapes |= {
            "direct.read": (code, MOUTH), "direct.rest": (MOUTH,),
            "direct.write": (MOUTH, code), "direct.share": (MOUTH, MOUTH),
        }  # fmt: skip
        linear("direct.listen", 2 * config.direct_dim, config.direct)
        linear("direct.think", config.direct, config.direct)
        linear("direct.move", config.direct, MOUTH)
        linear("direct.straight", 2 * config.direct_dim, MOUTH)
        linear("direct.hear", config.direct_dim, VOICE)
        linear("direct.voice", VOICE, 1)
    if config.contact:
        shapes |= {HEAD + "gap": (code,), HEAD + "rest": (), HEAD + "shut": (code,)}
        shapes[HEAD + "closures"] = (LIPS, config.contact_dim)
        linear(HEAD + "listen", 1 + len(KNOTS_MM) + config.contact_dim, config.contact)
        linear(HEAD + "move", config.contact, 1)
    return shapes


def zero_conv_shapes(config: ZeroConvConfig) -> dict[str, tuple[int, ...]]:
    """Names and shapes of the tensors of `ZeroConvs`."""
    shapes: dict[str, tuple[int, ...]] = {"embeddings": (len(config.labels), config.embedding)}
    for i, size in enumerate(config.places):
        for kind in ("shifts", "scales"):
            shapes[f"{kind}.{i}.weight"] = (size, config.embedding, 1)
            shapes[f"{kind}.{i}.bias"] = (size,)
    return shapes
