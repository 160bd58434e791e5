"""Sizes of the audio encoder, and the names and shapes of its weights; needs no torch.

Shared by the torch module (encoder.py) and its live twin (graph.py).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from math import exp, prod
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sensors.types import SAMPLE_RATE, SAMPLES_PER_FRAME

Doubles = NDArray[np.float64]
Singles = NDArray[np.float32]
Layer = tuple[int, int, int]  # width, kernel, stride


@dataclass(frozen=True)
class SpectrumConfig:
    bands: int
    rate: int
    hop: int = 200
    window: int = 600
    fall: int = 150  # samples of the window's end
    bins: int = 256
    low_hz: float = 60.0
    high_hz: float = 8000.0  # bins lie evenly up to here
    smooth_s: float = 0.06  # of the level
    release_s: float = 6.0  # of its peak, by a factor e of power
    floor: float = 3e-5  # power of a level that counts as silence
    quiet: float = 1e-5  # of the peak: what is softer is not told apart

    @property
    def keep(self) -> float:  # of the level, from hop to hop
        return exp(-self.hop / self.rate / self.smooth_s)

    @property
    def decay(self) -> float:  # of the log peak, each hop
        return self.hop / self.rate / self.release_s

    def shape(self) -> Doubles:
        """[window] weights of its samples."""
        rise = self.window - self.fall
        shape = np.concatenate([
            0.5 - 0.5 * np.cos(np.pi * (np.arange(rise) + 0.5) / rise),
            0.5 + 0.5 * np.cos(np.pi * (np.arange(self.fall) + 0.5) / self.fall),
        ])  # fmt: skip
        return shape / np.sqrt((shape**2).sum())

    def kernels(self) -> Doubles:
        """[window, 2 bins]: windowed cosines, then sines."""
        angles = 2 * np.pi * np.outer(np.arange(self.window), self.hz()) / self.rate
        return np.concatenate([np.cos(angles), np.sin(angles)], 1) * self.shape()[:, None]

    def powers(self, windows: Singles) -> Singles:
        """[n, window] -> [n, bins]: what `kernels` give, squared and added, in half the time."""
        length = round(self.rate * self.bins / self.high_hz)
        waves = np.fft.rfft(windows * self._shape, length)[:, 1 : self.bins + 1]
        return (waves.real**2 + waves.imag**2).astype(np.float32, copy=False)

    @cached_property
    def _shape(self) -> Singles:
        return self.shape().astype(np.float32)

    def hz(self) -> Doubles:  # [bins]
        return np.arange(1, self.bins + 1) * self.high_hz / self.bins

    def bank(self, warp: float = 1.0) -> Doubles:
        """[bins, bands] triangles; warp > 1 reads the spectrum as of a longer vocal tract."""
        low, high = (2595 * np.log10(1 + f / 700) for f in (self.low_hz, self.high_hz))
        edges = 700 * (10 ** (np.linspace(low, high, self.bands + 2) / 2595) - 1)
        step, hz = self.high_hz / self.bins, self.hz()[:, None] * warp
        middle = edges[1:-1]
        below, above = np.minimum(edges[:-2], middle - step), np.maximum(edges[2:], middle + step)
        sides = np.minimum((hz - below) / (middle - below), (above - hz) / (above - middle))
        triangles = np.clip(sides, 0, None)
        return triangles / np.sqrt(triangles.sum(0) + 1e-9)


@dataclass(frozen=True, kw_only=True)
class AudioEncoderConfig:
    kind: Literal["phonetic", "compact", "wav2vec-large"] = "compact"
    sample_rate: int = 24_000
    bands: int = 0  # of log mel spectra that the layers hear; 0: they hear the waveform
    layers: tuple[Layer, ...] = ((64, 10, 5), (128, 10, 5), (192, 4, 2), (256, 4, 2), (256, 4, 2))
    context: tuple[tuple[int, int], ...] = tuple((3, 2**i) for i in range(6))  # kernel, dilation
    feature_dim: int = 128  # 0: no projection, features are as wide as the last layer
    first_norm: Literal["running", "frozen"] = "running"  # all other layers are always frozen
    past_ticks: int = 0  # ticks before the newest whose mean features are heard with it
    second: AudioEncoderConfig | None = None  # another one beside it, whose features follow
    norm_seconds: float = 4.0  # time constant of the running statistics, and weight of their prior
    norm_floor: float = 0.03  # share of the prior's variance that silence cannot fall below

    @property
    def stride(self) -> int:
        hop = self.spectrum.hop if self.spectrum else 1
        return hop * prod(stride for _, _, stride in self.layers)

    @property
    def spectrum(self) -> SpectrumConfig | None:
        return SpectrumConfig(self.bands, self.sample_rate) if self.bands else None

    @property
    def width(self) -> int:
        return self.feature_dim or self.layers[-1][0]

    @property
    def features_a_tick(self) -> int:
        """0: not a whole number, they are interpolated."""
        samples = Fraction(SAMPLES_PER_FRAME * self.sample_rate, SAMPLE_RATE * self.stride)
        return int(samples) if samples.denominator == 1 else 0

    @property
    def parts(self) -> tuple[tuple[int, int], ...]:
        """(width, past ticks) of the features' parts: its own, the second's."""
        own = (self.width, self.past_ticks)
        return (own, *self.second.parts) if self.second else (own,)

    @property
    def frame_width(self) -> int:
        """Numbers of a tick's audio_features."""
        return sum(width * (self.features_a_tick + past or 1) for width, past in self.parts)


PHONETIC = AudioEncoderConfig(
    kind="phonetic",
    bands=60,
    layers=((256, 3, 1),),
    context=tuple((3, dilation) for dilation in (1, 2, 4, 8, 16, 32, 1)),
    feature_dim=74,
    first_norm="frozen",
    past_ticks=8,
)
PRESETS = {
    "debug": AudioEncoderConfig(
        layers=((8, 10, 5), (16, 10, 5), (16, 4, 2), (16, 4, 2), (32, 4, 2)),
        context=((3, 1), (3, 4)),
    ),
    "default": AudioEncoderConfig(),  # of the shipped weights
    "phonetic": PHONETIC,
    "phonetic-debug": replace(
        PHONETIC, bands=20, layers=((32, 3, 1),), context=((3, 1), (3, 4))
    ),
    "paper": AudioEncoderConfig(
        kind="wav2vec-large",
        sample_rate=16_000,
        layers=(
            (512, 10, 5), (512, 8, 4), (512, 4, 2), (512, 4, 2), (512, 4, 2),
            (512, 1, 1), (512, 1, 1),
        ),
        context=tuple((kernel, 1) for kernel in range(2, 14)),
        feature_dim=0,
    ),
}  # fmt: skip


SECOND = "second."  # how the names of the second encoder's tensors and states begin


def weight_shapes(config: AudioEncoderConfig) -> dict[str, tuple[int, ...]]:
    """Names and shapes of `AudioEncoder`'s tensors."""
    channels, shapes = config.bands or 1, dict[str, tuple[int, ...]]()
    if config.second:
        shapes |= {SECOND + name: shape for name, shape in weight_shapes(config.second).items()}

    def frozen_norm(name: str, width: int) -> None:
        for part in ("weight", "bias", "running_mean", "running_var"):
            shapes[f"{name}.{part}"] = (width,)
        shapes[f"{name}.num_batches_tracked"] = ()

    for i, (width, kernel, _) in enumerate(config.layers):
        shapes[f"convs.{i}.weight"] = (width, channels, kernel)
        channels = width
        if i == 0 and config.first_norm == "running":
            shapes |= {"norms.0.weight": (width,), "norms.0.bias": (width,), "norms.0.prior": (2,)}
        else:
            frozen_norm(f"norms.{i}", width)
    for i, (kernel, _) in enumerate(config.context):
        shapes[f"context_convs.{i}.weight"] = (channels, channels, kernel)
        shapes[f"context_convs.{i}.bias"] = (channels,)
        frozen_norm(f"context_norms.{i}", channels)
    if config.feature_dim:
        shapes["project.weight"] = (config.feature_dim, channels)
        shapes["project.bias"] = (config.feature_dim,)
    return shapes
