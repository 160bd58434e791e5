"""The audio path of one live tick: 1600 samples at 48 kHz -> audio_features, without torch.

Resampling and alignment in numpy around the ONNX graph of the encoder (graph.py). Its twin in
torch is `alignment.AudioFeatures`. Paper section 4.3.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from encoder.audio.config import SECOND, AudioEncoderConfig
from encoder.audio.framing import lerp_place, lerp_ready, resample_kernel
from encoder.audio.graph import ago, audio_memory, audio_model, sound_window
from encoder.nn.onnx_graph import Bits
from encoder.nn.onnx_session import session
from encoder.types import Floats, Weights
from sensors.types import SAMPLE_RATE, SAMPLES_PER_FRAME

KEPT = 8  # features that an interpolation may still read, where a tick has no whole number


@dataclass(frozen=True, eq=False)
class AudioState:
    """A value; no array in it is ever written."""

    raw: Floats  # [context] 48 kHz, still under the filter
    sound: Floats  # [n] resampled, still under a window or not yet a whole feature
    layers: dict[str, tuple[Floats, ...]]  # `audio_memory` of the last ticks, newest first
    tail: Floats  # [n, widths] newest first: means of past ticks; or the last to interpolate in
    count: int  # features so far


class LiveAudio:
    """Holds weights only. One stream, no batch axis."""

    def __init__(self, config: AudioEncoderConfig, weights: Weights, bits: Bits) -> None:
        self._stride, self._steady = config.stride, config.features_a_tick > 0
        self._factor = SAMPLE_RATE // config.sample_rate
        self._kernel = resample_kernel(self._factor)
        self._context = len(self._kernel) - self._factor
        tick = SAMPLES_PER_FRAME / self._factor / config.stride  # features a tick
        self._past = max(past for _, past in config.parts)
        self._width = sum(width for width, _ in config.parts)
        if self._steady:
            self._places = _places(config, self._past)
        self._memory = audio_memory(config)
        self._heard = [(ago(n, age), n, age - 1) for n, m in self._memory.items() for age in m.ages]
        self._outputs = ["features", *(f"{name}_next" for name in self._memory)]
        self._windows = {"windows": (*sound_window(config), config.spectrum)}
        if second := config.second:
            self._windows[f"{SECOND}windows"] = (*sound_window(second), second.spectrum)
        self._reach = max(size - hop for size, hop, _ in self._windows.values())
        self._priors = {
            name.replace("norms.0.prior", "statistics"): prior.reshape(1, 2).astype(np.float32)
            for name, prior in weights.items()
            if name.endswith("norms.0.prior")
        }
        counts = {int(tick), -int(-tick // 1)}
        self._encoders = {n: session(audio_model(config, weights, n, bits)) for n in counts}

    def init_state(self) -> AudioState:
        layers = {
            name: (self._priors.get(name, np.zeros(memory.shape, np.float32)),) * max(memory.ages)
            for name, memory in self._memory.items()
        }
        raw, sound = np.zeros(self._context, np.float32), np.zeros(self._reach, np.float32)
        tail = np.zeros((self._past, self._width), np.float32)
        return AudioState(raw, sound, layers, tail, 0)

    def step(self, audio: Floats, state: AudioState) -> tuple[Floats, AudioState]:
        """audio [1600] at 48 kHz -> audio_features [A], the next state."""
        raw = np.concatenate([state.raw, audio])
        ready = (len(raw) - self._context) // self._factor
        fresh = _windows(raw, ready, len(self._kernel), self._factor) @ self._kernel
        sound = np.concatenate([state.sound, fresh])
        num = (len(sound) - self._reach) // self._stride
        used = num * self._stride
        inputs = dict[str, Floats]()
        for name, (size, hop, spectrum) in self._windows.items():
            heard = _windows(sound[self._reach - size + hop :], used // hop, size, hop)
            inputs[name] = spectrum.powers(heard) if spectrum else heard.copy()
        for name, memory, age in self._heard:
            inputs[name] = state.layers[memory][age]
        features, *after = self._encoders[num].run(self._outputs, inputs)
        layers = {
            name: (array, *state.layers[name][:-1])
            for name, array in zip(self._memory, after, strict=True)
        }
        raw, sound, count = raw[ready * self._factor :], sound[used:], state.count + num
        if self._steady:
            rows = np.concatenate([features, state.tail])
            tail = np.concatenate([features.mean(0, keepdims=True), state.tail[:-1]])
            return rows.take(self._places), AudioState(raw, sound, layers, tail, count)
        tail = np.concatenate([state.tail, features])[-KEPT:]
        left, weight = lerp_place(lerp_ready(count) - 1)
        place = left - (count - len(tail))
        pair = tail[place : place + 2]
        mixed = pair[0] + np.float32(weight) * (pair[-1] - pair[0])
        return mixed, AudioState(raw, sound, layers, tail, count)


def _places(config: AudioEncoderConfig, past: int) -> NDArray[np.intp]:
    """Where the numbers of audio_features lie in the rows of a tick's features and what its past
    left: part after part, first the newest rows, then the means of earlier ticks."""
    num, width = config.features_a_tick, sum(width for width, _ in config.parts)
    rows, places, start = np.arange((num + past) * width).reshape(-1, width), [], 0
    for part, ticks in config.parts:
        places.append(rows[: num + ticks, start : start + part].reshape(-1))
        start += part
    return np.concatenate(places)


def _windows(samples: Floats, count: int, size: int, hop: int) -> Floats:
    """[n] -> [count, size], a view; in a tenth of the time of `sliding_window_view`."""
    step = samples.itemsize
    return np.ndarray((count, size), samples.dtype, samples, strides=(hop * step, step))
