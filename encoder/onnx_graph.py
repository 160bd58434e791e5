"""One tick of the audio encoder and of the denoiser as ONNX graphs, built from the weights.

Everything constant is folded: frozen norms into convolutions, tau = N into AdaLN, gates and scales
into projections. Convolutions become one gather and one matrix product, which int8 needs. Weights
have 8 bits with one scale a column, activations are quantised when they arrive (paper section 4.3).
"""

from __future__ import annotations

from math import exp, log
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from onnx import ModelProto

    from encoder.audio_encoder import AudioEncoderConfig
    from encoder.denoiser import DenoiserConfig

Array = NDArray[Any]
Weights = dict[str, Array]
# Of products: the same numbers, signed or 128 more (see backends.eight_bits); None: full precision.
Bits = Literal["int8", "uint8"] | None
MIN_INT8_INPUTS = 64  # shorter products gain nothing and lose accuracy
EXACT_CONVS = 3  # they hear a click beside near silence, which one int8 scale cannot hold


class Graph:
    """Collects nodes and constants; every method returns the name of its output."""

    def __init__(self, bits: Bits) -> None:
        self.bits: Bits = bits
        self.nodes: list[Any] = []
        self.constants: list[Any] = []

    def _name(self) -> str:
        return f"v{len(self.nodes)}_{len(self.constants)}"

    def const(self, array: Array | list[int]) -> str:
        from onnx import numpy_helper

        array = np.asarray(array)
        array = array.astype(np.float32) if array.dtype == np.float64 else array
        self.constants.append(numpy_helper.from_array(array, f"c{len(self.constants)}"))
        return self.constants[-1].name

    def op(
        self, kind: str, *inputs: str, outputs: int = 1, domain: str = "", **attributes: Any
    ) -> Any:
        from onnx import helper

        names = [f"{self._name()}_{i}" for i in range(outputs)]
        self.nodes.append(helper.make_node(kind, inputs, names, domain=domain, **attributes))
        return names[0] if outputs == 1 else names

    def linear(self, x: str, weight: Array, bias: Array, *, exact: bool = False) -> str:
        """x [rows, inputs] @ weight [inputs, outputs] + bias; exact: in full precision."""
        if exact or not self.bits or weight.shape[0] < MIN_INT8_INPUTS:
            return self.op("Gemm", x, self.const(weight), self.const(bias))
        scale = np.maximum(np.abs(weight).max(0), 1e-12) / 127
        zero, where = 0, ""  # none: a zero point costs the signed ones a twentieth of their time
        if self.bits == "uint8":
            zero, where = 128, self.const(np.array(128, np.uint8))
        quantised = (np.rint(weight / scale) + zero).astype(self.bits)
        names = [self.const(quantised), self.const(scale), where, self.const(bias)]
        return self.op("DynamicQuantizeMatMul", x, *names, domain="com.microsoft")

    def rename(self, name: str, output: str) -> None:
        from onnx import helper

        self.nodes.append(helper.make_node("Identity", [name], [output]))

    def model(self, inputs: dict[str, list[int]], outputs: dict[str, list[int]]) -> ModelProto:
        from onnx import TensorProto, helper

        def infos(shapes: dict[str, list[int]]) -> list[Any]:
            return [
                helper.make_tensor_value_info(name, TensorProto.FLOAT, shape)
                for name, shape in shapes.items()
            ]

        graph = helper.make_graph(
            self.nodes, "tick", infos(inputs), infos(outputs), initializer=self.constants
        )
        opsets = [helper.make_opsetid("", 20), helper.make_opsetid("com.microsoft", 1)]
        return helper.make_model(graph, opset_imports=opsets, ir_version=10)


def _conv(
    g: Graph, x: str, context: str, weights: Weights, name: str,
    time: int, stride: int, dilation: int,
    scale: Array | float = 1.0, shift: Array | float = 0.0, *, exact: bool = False,
) -> tuple[str, str]:  # fmt: skip
    """Causal convolution of x [time, C] after context [n, C], then scale and shift a channel."""
    weight = weights[f"{name}.weight"]  # [C', C, k]
    width, channels, kernel = weight.shape
    n = dilation * (kernel - 1) + 1 - stride
    joined = g.op("Concat", context, x, axis=0)
    starts = np.arange(0, time, stride)[:, None]
    index = g.const((starts + np.arange(kernel) * dilation).reshape(-1))
    rows = g.op("Gather", joined, index, axis=0)
    rows = g.op("Reshape", rows, g.const([time // stride, kernel * channels]))
    matrix = weight.transpose(2, 1, 0).reshape(-1, width) * scale
    bias = weights.get(f"{name}.bias", np.zeros(width)) * scale + shift
    y = g.linear(rows, matrix, bias, exact=exact)
    return y, g.op("Slice", joined, g.const([time]), g.const([time + n]), g.const([0]))


def _frozen(weights: Weights, name: str) -> tuple[Array, Array]:
    """Frozen norm as scale and shift."""
    scale = weights[f"{name}.weight"] / np.sqrt(weights[f"{name}.running_var"] + 1e-5)
    return scale, weights[f"{name}.bias"] - weights[f"{name}.running_mean"] * scale


def _running_norm(
    g: Graph, x: str, config: AudioEncoderConfig, weights: Weights, hops: int
) -> tuple[str, str]:
    """RunningNorm.step on x [hops * n, C]; reads the input "statistics" [1, 2] -> y, statistics."""
    width, _, stride = config.layers[0]
    keep = exp(-config.stride / config.sample_rate / config.norm_seconds)
    flat = g.op("Reshape", x, g.const([hops, -1]))
    axis = g.const([1])
    moments = [g.op("ReduceMean", flat, axis), g.op("ReduceMean", g.op("Mul", flat, flat), axis)]
    lag = np.subtract.outer(np.arange(hops), np.arange(hops))
    past = np.where(lag >= 0, (1 - keep) * keep ** np.maximum(lag, 0), 0.0)
    fresh = g.op("MatMul", g.const(past), g.op("Concat", *moments, axis=1))
    start = g.op("MatMul", g.const(keep ** np.arange(1.0, hops + 1)[:, None]), "statistics")
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


def audio_shapes(config: AudioEncoderConfig) -> dict[str, list[int]]:
    """Names and shapes of the streaming state, channels last, without the batch axis."""
    channels, shapes = 1, {}
    for width, kernel, stride in config.layers:
        shapes[f"conv{len(shapes)}"] = [kernel - stride, channels]
        channels = width
    for kernel, dilation in config.context:
        shapes[f"conv{len(shapes)}"] = [dilation * (kernel - 1), channels]
    if config.first_norm == "running":
        shapes["statistics"] = [1, 2]
    return shapes


def audio_model(
    config: AudioEncoderConfig, weights: Weights, features: int, bits: Bits
) -> ModelProto:
    """audio [features * stride, 1] + state -> features [features, width] + state."""
    g, time, x, after = Graph(bits), features * config.stride, "audio", {}
    for i, (_, _, stride) in enumerate(config.layers):
        running = i == 0 and config.first_norm == "running"
        scale, shift = (1.0, 0.0) if running else _frozen(weights, f"norms.{i}")
        state = f"conv{i}"
        x, after[state] = _conv(
            g, x, state, weights, f"convs.{i}", time, stride, 1, scale, shift,
            exact=i < EXACT_CONVS,
        )  # fmt: skip
        time //= stride
        if running:
            x, after["statistics"] = _running_norm(g, x, config, weights, features)
        x = g.op("Relu", x)
    x = g.op("Log", g.op("Add", x, g.const(np.array([1.0]))))
    half = g.const(np.array([0.5**0.5]))
    for i, (_, dilation) in enumerate(config.context):
        state = f"conv{len(config.layers) + i}"
        folded = _frozen(weights, f"context_norms.{i}")
        y, after[state] = _conv(
            g, x, state, weights, f"context_convs.{i}", time, 1, dilation, *folded
        )
        x = g.op("Mul", g.op("Add", g.op("Relu", y), x), half)
    if config.feature_dim:
        x = g.linear(x, weights["project.weight"].T, weights["project.bias"])
    g.rename(x, "features")
    for name, value in after.items():
        g.rename(value, f"{name}_next")
    shapes = audio_shapes(config)
    return g.model(
        {"audio": [features * config.stride, 1], **shapes},
        {"features": [features, config.width], **{f"{k}_next": v for k, v in shapes.items()}},
    )


def _embedded_tau(config: DenoiserConfig, weights: Weights) -> Array:
    """What the tau network says at tau = N: [dim] float64."""
    half = config.dim // 2
    angles = config.num_steps * np.exp(np.arange(half) * (-log(10_000.0) / half))
    x = np.concatenate([np.cos(angles), np.sin(angles)])
    for i in (0, 2):
        x = weights[f"tau.{i}.weight"].astype(np.float64) @ x + weights[f"tau.{i}.bias"]
        x = x / (1 + np.exp(-x))
    return x


def _attention(
    g: Graph, x: str, i: int, config: DenoiserConfig, weights: Weights, gate: Array
) -> tuple[str, str, str]:
    """x [1, dim] -> gated output [1, dim], the new rotated key and value [H, 1, D]."""
    name, heads, head_dim = f"blocks.{i}.attention", config.heads, config.dim // config.heads
    weight, bias = weights[f"{name}.qkv.weight"].T.copy(), weights[f"{name}.qkv.bias"].copy()
    weight[:, : config.dim] *= head_dim**-0.5
    bias[: config.dim] *= head_dim**-0.5
    qkv = g.op("Reshape", g.linear(x, weight, bias), g.const([3 * heads, 1, head_dim]))
    sizes = g.const([2 * heads, heads])
    turning, v = g.op("Split", qkv, sizes, axis=0, outputs=2)
    a, b = g.op("Split", turning, axis=2, num_outputs=2, outputs=2)
    swapped = g.op("Concat", g.op("Neg", b), a, axis=2)
    turned = g.op("Add", g.op("Mul", turning, "cos"), g.op("Mul", swapped, "sin"))
    q, k = g.op("Split", turned, axis=0, num_outputs=2, outputs=2)
    layer = g.const(np.array(i))
    keys = g.op("Concat", g.op("Gather", "keys", layer, axis=0), k, axis=1)
    values = g.op("Concat", g.op("Gather", "values", layer, axis=0), v, axis=1)
    scores = g.op("MatMul", q, g.op("Transpose", keys, perm=[0, 2, 1]))
    y = g.op("MatMul", g.op("Softmax", g.op("Add", scores, "bias"), axis=-1), values)
    y = g.op("Reshape", y, g.const([1, config.dim]))
    out, out_bias = weights[f"{name}.out.weight"].T * gate, weights[f"{name}.out.bias"] * gate
    return g.linear(y, out, out_bias), k, v


def _contact(g: Graph, x0: str, config: DenoiserConfig, weights: Weights) -> str:
    """x0 [1, 256] with the head of contact.py behind it."""
    from encoder.contact import KNOTS_MM, REACH_MM

    sizes = [config.expression_dim, config.audio_dim, config.condition_dim]
    _, audio, _ = g.op("Split", "inputs", g.const(sizes), outputs=3, axis=1)
    row, rest = weights["contact.gap"][:, None], weights["contact.rest"].reshape(1)
    gap = g.linear(x0, row, rest, exact=True)
    near = g.op("Relu", g.op("Sub", g.const(np.array([KNOTS_MM])), gap))
    seen = g.op("Concat", gap, near, audio, axis=1)

    def layer(x: str, name: str) -> str:
        weight, bias = (weights[f"contact.{name}.{part}"] for part in ("weight", "bias"))
        return g.linear(x, weight.T, bias, exact=True)

    moved = g.op("Tanh", layer(g.op("Relu", layer(seen, "listen")), "move"))
    return g.op("Add", x0, g.op("Mul", moved, g.const(REACH_MM * weights["contact.shut"][None])))


def denoiser_model(config: DenoiserConfig, weights: Weights, bits: Bits) -> ModelProto:
    """One frame at tau = N. keys, values [L, H, w, D] hold the past, rotated, in any order; bias
    [1, 1, w + 1] is 0 for a valid slot and very negative for a stale one; emotion [1, width]
    holds the shift and the scale of each place (zeros: nothing; zero_conv.py)."""
    g, dim, tau = Graph(bits), config.dim, _embedded_tau(config, weights)
    # in full precision: what is small among the inputs tells as much as what is large
    x = g.linear("inputs", weights["input.weight"].T, weights["input.bias"], exact=True)
    new_keys, new_values = [], []

    places = np.repeat(config.places, 2)
    moods = g.op("Split", "emotion", g.const(places), outputs=len(places), axis=1)

    def felt(x: str, place: int) -> str:
        scale = g.op("Add", moods[2 * place + 1], g.const(np.array([1.0])))
        return g.op("Add", g.op("Mul", x, scale), moods[2 * place])

    for i in range(config.layers):
        name, x = f"blocks.{i}", felt(x, i)
        modulation = weights[f"{name}.modulate.weight"] @ tau + weights[f"{name}.modulate.bias"]
        shift1, scale1, gate1, shift2, scale2, gate2 = np.split(modulation, 6)
        y = g.op("LayerNormalization", x, g.const(1 + scale1), g.const(shift1), epsilon=1e-5)
        y, k, v = _attention(g, y, i, config, weights, gate1)
        new_keys.append(k)
        new_values.append(v)
        x = g.op("Add", x, y)
        y = g.op("LayerNormalization", x, g.const(1 + scale2), g.const(shift2), epsilon=1e-5)
        y = g.linear(y, weights[f"{name}.up.weight"].T, weights[f"{name}.up.bias"])
        y = g.op("Gelu", y, approximate="tanh")
        down, down_bias = weights[f"{name}.down.weight"].T, weights[f"{name}.down.bias"]
        x = g.op("Add", x, g.linear(y, down * gate2, down_bias * gate2))
    x = felt(x, config.layers)
    scale, shift = g.const(weights["norm.weight"]), g.const(weights["norm.bias"])
    x = g.op("LayerNormalization", x, scale, shift, epsilon=1e-5)
    x0 = g.linear(x, weights["output.weight"].T, weights["output.bias"])
    x0 = felt(x0, config.layers + 1)
    g.rename(_contact(g, x0, config, weights) if config.contact else x0, "x0")
    new = [config.layers, config.heads, dim // config.heads]
    g.rename(g.op("Reshape", g.op("Concat", *new_keys, axis=0), g.const(new)), "key")
    g.rename(g.op("Reshape", g.op("Concat", *new_values, axis=0), g.const(new)), "value")
    cache = [config.layers, config.heads, config.window, dim // config.heads]
    inputs = config.expression_dim + config.audio_dim + config.condition_dim
    rope = [1, 1, dim // config.heads]
    return g.model(
        {"inputs": [1, inputs], "keys": cache, "values": cache, "cos": rope, "sin": rope,
         "bias": [1, 1, config.window + 1], "emotion": [1, int(places.sum())]},
        {"x0": [1, config.expression_dim], "key": new, "value": new},
    )  # fmt: skip
