"""One tick of the audio encoder as an ONNX graph.

Frozen norms are folded into the convolutions, and these become one gather and one matrix product,
which int8 needs. It begins with windows of the sound. What it remembers of a tick comes back ticks
later, as inputs named by `ago`: nothing is shifted or copied meanwhile.
"""

from __future__ import annotations

from math import exp
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from encoder.audio.config import SECOND
from encoder.nn.onnx_graph import Array, Bits, Graph
from encoder.types import Weights

if TYPE_CHECKING:
    from onnx import ModelProto

    from encoder.audio.config import AudioEncoderConfig, SpectrumConfig

EXACT_CONVS = 3  # they hear a click beside near silence, which one int8 scale cannot hold


class Memory(NamedTuple):
    """A tensor that every tick leaves behind."""

    shape: list[int]
    ages: tuple[int, ...] = (1,)  # ticks after which it is read
    taps: bool = False  # each time by one tap of a convolution, whole


def ago(name: str, age: int) -> str:
    """The graph's input for what the memory `name` was so many ticks ago."""
    return f"{name}_{age}"


def sound_window(config: AudioEncoderConfig) -> tuple[int, int]:
    """Size and hop of the windows that the first layer hears, or their powers, in samples."""
    if spectrum := config.spectrum:
        return spectrum.window, spectrum.hop
    _, kernel, stride = config.layers[0]
    return kernel, stride


def _conv(
    g: Graph, x: str, state: str, memory: Memory, product: tuple[Array, Array],
    time: int, kernel: int, stride: int, dilation: int, *, exact: bool = False,
) -> tuple[str, str]:  # fmt: skip
    """Causal convolution of x [time, C] -> y, what is remembered; product: matrix and bias."""
    if memory.taps:
        rows = g.op("Concat", *(ago(state, age) for age in memory.ages), x, axis=1)
        return g.linear(rows, *product, exact=exact), x
    kept = memory.shape[0]
    joined = g.op("Concat", ago(state, 1), x, axis=0)
    first = kept + stride - 1 - dilation * (kernel - 1)
    starts = np.arange(first, first + time, stride)[:, None]
    index = g.const((starts + np.arange(kernel) * dilation).reshape(-1))
    rows = g.op("Gather", joined, index, axis=0)
    rows = g.op("Reshape", rows, g.const([time // stride, len(product[0])]))
    y = g.linear(rows, *product, exact=exact)
    if kept == time:
        return y, x
    return y, g.op("Slice", joined, g.const([time]), g.const([time + kept]), g.const([0]))


def _as_product(weights: Weights, name: str, scale: Array, shift: Array) -> tuple[Array, Array]:
    """A convolution's matrix [k C, C'] and bias [C'], scaled and shifted a channel."""
    weight = weights[f"{name}.weight"]  # [C', C, k]
    matrix = weight.transpose(2, 1, 0).reshape(-1, len(weight)) * scale
    return matrix, weights.get(f"{name}.bias", np.zeros(len(weight))) * scale + shift


def _frozen(weights: Weights, name: str) -> tuple[Array, Array]:
    """Frozen norm as scale and shift."""
    scale = weights[f"{name}.weight"] / np.sqrt(weights[f"{name}.running_var"] + 1e-5)
    return scale, weights[f"{name}.bias"] - weights[f"{name}.running_mean"] * scale


def _running_norm(
    g: Graph, x: str, state: str, config: AudioEncoderConfig, weights: Weights, hops: int
) -> tuple[str, str]:
    """RunningNorm.step on x [hops * n, C]; remembers `state` [1, 2] -> y, statistics."""
    width, _, stride = config.layers[0]
    keep = exp(-config.stride / config.sample_rate / config.norm_seconds)
    flat = g.op("Reshape", x, g.const([hops, -1]))
    axis = g.const([1])
    moments = [g.op("ReduceMean", flat, axis), g.op("ReduceMean", g.op("Mul", flat, flat), axis)]
    lag = np.subtract.outer(np.arange(hops), np.arange(hops))
    past = np.where(lag >= 0, (1 - keep) * keep ** np.maximum(lag, 0), 0.0)
    fresh = g.op("MatMul", g.const(past), g.op("Concat", *moments, axis=1))
    start = g.op("MatMul", g.const(keep ** np.arange(1.0, hops + 1)[:, None]), ago(state, 1))
    means = g.op("Add", fresh, start)  # [hops, 2]
    mean, square = g.op("Split", means, axis=1, num_outputs=2, outputs=2)
    prior = weights["norms.0.prior"].astype(np.float64)
    floor = config.norm_floor * (prior[1] - prior[0] ** 2) + 1e-9
    variance = g.op("Relu", g.op("Sub", square, g.op("Mul", mean, mean)))
    deviation = g.op("Sqrt", g.op("Add", variance, g.const(np.array([floor]))))
    normal = g.op("Div", g.op("Sub", flat, mean), deviation)
    normal = g.op("Reshape", normal, g.const([hops * config.stride // stride, width]))
    y = g.op("Mul", normal, g.const(weights["norms.0.weight"]))
    y = g.op("Add", y, g.const(weights["norms.0.bias"]))
    return y, g.op("Slice", means, g.const([hops - 1]), g.const([hops]), g.const([0]))


def _spectrum(
    g: Graph, x: str, config: SpectrumConfig, hops: int, names: str
) -> tuple[str, dict[str, str]]:
    """Spectrum.step on powers x [hops, bins] -> [hops, bands] and its next state."""
    bands = g.op("MatMul", x, g.const(config.bank()))
    lag = np.subtract.outer(np.arange(hops), np.arange(hops))
    past = np.where(lag >= 0, (1 - config.keep) * config.keep ** np.maximum(lag, 0), 0.0)
    fresh = g.op("MatMul", g.const(past), g.op("ReduceMean", bands, g.const([1])))
    ages = np.arange(1.0, hops + 1)[:, None]
    levels = g.op("Add", fresh, g.op("MatMul", g.const(config.keep**ages), ago(f"{names}level", 1)))
    one, floor = g.const(np.array([1.0])), g.const(np.array([config.floor]))
    logs = g.op("Log", g.op("Add", g.op("Div", levels, floor), one))
    faded = g.const(np.where(lag >= 0, -config.decay * lag, -1e9))
    newest = g.op("ReduceMax", g.op("Add", g.op("Transpose", logs), faded), g.const([1]))
    peaks = g.op("Max", newest, g.op("Sub", ago(f"{names}peak", 1), g.const(config.decay * ages)))
    scale = g.op("Mul", g.op("Exp", peaks), floor)
    relative = g.op("Add", g.op("Div", bands, scale), g.const(np.array([config.quiet])))
    y = g.op("Add", g.op("Log", relative), g.const(np.array([5.0])))
    ends = g.const([hops - 1]), g.const([hops]), g.const([0])
    after = {
        names + name: g.op("Slice", rows, *ends)
        for name, rows in (("level", levels), ("peak", peaks))
    }
    return g.op("Div", y, g.const(np.array([3.0]))), after


def _context_memory(config: AudioEncoderConfig, kernel: int, dilation: int) -> Memory:
    """Of a layer's inputs: whole ticks where these will do, else the rows it still hears."""
    time, channels, rows = config.features_a_tick, config.layers[-1][0], dilation * (kernel - 1)
    if time and dilation % time == 0:
        ages = tuple(tap * dilation // time for tap in range(kernel - 1, 0, -1))
        return Memory([time, channels], ages, taps=True)
    return Memory([max(rows, time), channels])


def audio_memory(config: AudioEncoderConfig) -> dict[str, Memory]:
    """What a stream remembers but for its sound, channels last, without the batch axis."""
    channels, found = config.bands or 1, dict[str, Memory]()
    for i, (width, kernel, stride) in enumerate(config.layers):
        if i > 0 or config.bands:
            found[f"conv{i}"] = Memory([kernel - stride, channels])
        channels = width
    for i, (kernel, dilation) in enumerate(config.context):
        found[f"context{i}"] = _context_memory(config, kernel, dilation)
    if config.first_norm == "running":
        found["statistics"] = Memory([1, 2])
    if config.spectrum:
        found |= {"level": Memory([1, 1]), "peak": Memory([1, 1])}
    if config.second:
        found |= {SECOND + name: memory for name, memory in audio_memory(config.second).items()}
    return found


def _encoder(
    g: Graph, config: AudioEncoderConfig, weights: Weights, features: int, names: str = ""
) -> tuple[str, dict[str, str]]:
    """The input "windows" -> features and the next state; `names`: how its inputs begin."""
    memory, after, x = audio_memory(config), dict[str, str](), f"{names}windows"
    time = features * config.stride // sound_window(config)[1]
    if config.spectrum:
        x, after = _spectrum(g, x, config.spectrum, time, names)
    for i, (_, kernel, stride) in enumerate(config.layers):
        running, exact = i == 0 and config.first_norm == "running", i < EXACT_CONVS
        frozen = (np.ones(1), np.zeros(1)) if running else _frozen(weights, f"norms.{i}")
        product, state = _as_product(weights, f"convs.{i}", *frozen), f"{names}conv{i}"
        if f"conv{i}" in memory:
            x, after[state] = _conv(
                g, x, state, memory[f"conv{i}"], product, time, kernel, stride, 1, exact=exact
            )
            time //= stride
        else:
            x = g.linear(x, *product, exact=exact)
        if running:
            state = f"{names}statistics"
            x, after[state] = _running_norm(g, x, state, config, weights, features)
        x = g.op("Relu", x)
    if not config.bands:
        x = g.op("Log", g.op("Add", x, g.const(np.array([1.0]))))
    # Sums are not brought back to size (factor .5 ** .5) layer by layer, but biases grow with them.
    grown = 1.0
    for i, (kernel, dilation) in enumerate(config.context):
        state, frozen = f"{names}context{i}", _frozen(weights, f"context_norms.{i}")
        matrix, bias = _as_product(weights, f"context_convs.{i}", *frozen)
        y, after[state] = _conv(
            g, x, state, memory[f"context{i}"], (matrix, bias * grown), time, kernel, 1, dilation
        )
        x, grown = g.op("Add", g.op("Relu", y), x), grown * 2**0.5
    if config.feature_dim:
        x = g.linear(x, weights["project.weight"].T / grown, weights["project.bias"])
    else:
        x = g.op("Mul", x, g.const(np.array([1 / grown])))
    return x, after


def audio_model(
    config: AudioEncoderConfig, weights: Weights, features: int, bits: Bits
) -> ModelProto:
    """windows of the sound [n, size] + memory -> features [features, widths] + memory."""
    g = Graph(bits)
    x, after = _encoder(g, config, weights, features)
    if config.second:
        theirs = {k.removeprefix(SECOND): v for k, v in weights.items() if k.startswith(SECOND)}
        y, more = _encoder(g, config.second, theirs, features, SECOND)
        x, after = g.op("Concat", x, y, axis=1), after | more
    g.rename(x, "features")
    for name, value in after.items():
        g.rename(value, f"{name}_next")
    memory = audio_memory(config)
    heard = {ago(name, age): m.shape for name, m in memory.items() for age in m.ages}
    for names, part in (("", config), (SECOND, config.second)):
        if part:
            size, hop = sound_window(part)
            width = part.spectrum.bins if part.spectrum else size
            heard[f"{names}windows"] = [features * part.stride // hop, width]
    return g.model(
        heard,
        {"features": [features, sum(width for width, _ in config.parts)],
         **{f"{name}_next": m.shape for name, m in memory.items()}},
    )  # fmt: skip
