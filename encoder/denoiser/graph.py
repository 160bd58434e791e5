"""One tick of the denoiser as an ONNX graph.

tau = N is folded into AdaLN, gates and scales into the projections.
"""

from __future__ import annotations

from math import log
from typing import TYPE_CHECKING

import numpy as np

from encoder.denoiser.config import ACTS_MM, KNOTS_MM, PARTED_MM, UNHEARD
from encoder.nn.onnx_graph import Array, Bits, Graph
from encoder.types import Weights

if TYPE_CHECKING:
    from onnx import ModelProto

    from encoder.denoiser.config import DenoiserConfig


def _embedded_tau(config: DenoiserConfig, weights: Weights) -> Array:
    """Output of the tau network at tau = N: [dim] float64."""
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
    halves = g.const(np.roll(np.arange(head_dim), head_dim // 2))
    swapped = g.op("Gather", qkv, halves, axis=2)
    turned = g.op("Add", g.op("Mul", qkv, "cos"), g.op("Mul", swapped, "sin"))
    q, k, v = g.op("Split", turned, axis=0, num_outputs=3, outputs=3)
    keys = g.op("Concat", f"keys{i}", k, axis=1)
    values = g.op("Concat", f"values{i}", v, axis=1)
    scores = g.op("MatMul", q, g.op("Transpose", keys, perm=[0, 2, 1]))
    y = g.op("MatMul", g.op("Softmax", g.op("Add", scores, "bias"), axis=-1), values)
    y = g.op("Reshape", y, g.const([1, config.dim]))
    out, out_bias = weights[f"{name}.out.weight"].T * gate, weights[f"{name}.out.bias"] * gate
    return g.linear(y, out, out_bias), k, v


def _direct(g: Graph, x0: str, heard: str, weights: Weights) -> tuple[str, str]:
    """direct.py: x0 [1, 256], log-odds heard [1, D] -> x0 [1, 256], probability of a voice
    [1, 1]."""

    def layer(x: str, name: str) -> str:
        weight, bias = (weights[f"direct.{name}.{part}"] for part in ("weight", "bias"))
        return g.linear(x, weight.T, bias, exact=True)

    # One product for the log-odds and one for their sigmoids: quantised together, the large
    # log-odds would leave few of the 8 bits to the sigmoids.
    names = ("listen", "straight", "hear")
    listen, straight, hear = (weights[f"direct.{name}.weight"].T for name in names)
    odds, sure = np.split(np.concatenate([listen, straight], 1), 2)
    bias = np.concatenate([weights[f"direct.{name}.bias"] for name in names])
    all_odds = g.linear(heard, np.concatenate([odds, hear], 1), bias)
    widths = [listen.shape[1], straight.shape[1], hear.shape[1]]
    own_hidden, own_said, voices = g.op("Split", all_odds, g.const(widths), axis=1, outputs=3)
    all_sure = g.linear(g.op("Sigmoid", heard), sure, np.zeros(sure.shape[1]))
    hidden, said = g.op("Split", all_sure, g.const(widths[:2]), axis=1, outputs=2)
    hidden = g.op("Relu", g.op("Add", own_hidden, hidden))
    moved = layer(g.op("Relu", layer(hidden, "think")), "move")
    said = g.op("Add", moved, g.op("Add", own_said, said))

    own = g.linear(x0, weights["direct.read"], weights["direct.rest"], exact=True)
    mixed = g.op("Add", g.op("MatMul", own, g.const(weights["direct.share"])), said)
    voice = g.op("Sigmoid", layer(g.op("Relu", voices), "voice"))
    change = g.op("Sub", g.op("Mul", voice, mixed), own)
    return g.op("Add", x0, g.op("MatMul", change, g.const(weights["direct.write"]))), voice


def _contact(g: Graph, x0: str, audio: str, voice: str, weights: Weights, reach_mm: float) -> str:
    """contact.py: x0 [1, 256], audio [1, A], voice [1, 1] -> x0 [1, 256]."""
    row, rest = weights["contact.gap"][:, None], weights["contact.rest"].reshape(1)
    gap = g.linear(x0, row, rest, exact=True)
    near = g.op("Relu", g.op("Sub", g.const(np.array([KNOTS_MM])), gap))
    seen = g.op("Concat", gap, near, audio, axis=1)

    def layer(x: str, name: str) -> str:
        weight, bias = (weights[f"contact.{name}.{part}"] for part in ("weight", "bias"))
        return g.linear(x, weight.T, bias, exact=True)

    def share(x: str, low: float, high: float) -> str:
        """1 up to low, 0 from high on."""
        left = g.op("Sub", g.const(np.array([[high]])), x)
        left = g.op("Relu", g.op("Mul", left, g.const(np.array([[1 / (high - low)]]))))
        return g.op("Min", left, g.const(np.ones((1, 1))))

    moved = g.op("Tanh", layer(g.op("Relu", layer(seen, "listen")), "move"))
    reach = g.op("Mul", voice, g.const(np.array([[reach_mm]])))
    moved = g.op("Mul", g.op("Mul", moved, share(gap, *ACTS_MM)), reach)
    rows = weights["contact.closures"].T
    heard = g.linear(audio, rows, np.zeros(rows.shape[1]), exact=True)
    heard = g.op("ReduceMax", heard, g.const([1]))
    missing = g.op("Sub", g.const(np.array([[PARTED_MM]])), g.op("Add", gap, moved))
    parted = g.op("Mul", g.op("Relu", missing), share(heard, *UNHEARD))
    moved = g.op("Add", moved, g.op("Mul", parted, voice))
    return g.op("Add", x0, g.op("Mul", moved, g.const(weights["contact.shut"][None])))


def denoiser_model(
    config: DenoiserConfig, weights: Weights, bits: Bits, *, emotion: bool
) -> ModelProto:
    """One frame at tau = N.

    inputs [1, ...]: DenoiserConfig.input_dims; heard [1, contact_dim]: what the direct path and the
    contact head hear. keys, values of each layer [H, w, D]: the past, with rotary positions
    applied, in any order; cos, sin [3 H, 1, D]: what turns query, key and value to the position of
    this frame, the first half of the sines negative; bias [1, 1, w + 1]: 0 for a valid slot, very
    negative for a stale one; with `emotion` [1, width]: shift and scale of each place where an
    emotion acts (zero_conv.py). -> x0 [1, 256]; row [2 H L, 1, D]: key and value of each layer.
    """
    g, dim, tau = Graph(bits), config.dim, _embedded_tau(config, weights)
    # in full precision: the small inputs matter as much as the large ones
    x = g.linear("inputs", weights["input.weight"].T, weights["input.bias"], exact=True)
    row = list[str]()

    places, moods = np.repeat(config.places, 2), list[str]()
    if emotion:
        moods = g.op("Split", "emotion", g.const(places), outputs=len(places), axis=1)

    def with_emotion(x: str, place: int) -> str:
        if not emotion:
            return x
        scale = g.op("Add", moods[2 * place + 1], g.const(np.array([1.0])))
        return g.op("Add", g.op("Mul", x, scale), moods[2 * place])

    for i in range(config.layers):
        name, x = f"blocks.{i}", with_emotion(x, i)
        modulation = weights[f"{name}.modulate.weight"] @ tau + weights[f"{name}.modulate.bias"]
        shift1, scale1, gate1, shift2, scale2, gate2 = np.split(modulation, 6)
        y = g.op("LayerNormalization", x, g.const(1 + scale1), g.const(shift1), epsilon=1e-5)
        y, k, v = _attention(g, y, i, config, weights, gate1)
        row += [k, v]
        x = g.op("Add", x, y)
        y = g.op("LayerNormalization", x, g.const(1 + scale2), g.const(shift2), epsilon=1e-5)
        y = g.linear(y, weights[f"{name}.up.weight"].T, weights[f"{name}.up.bias"])
        y = g.op("Gelu", y, approximate="tanh")
        down, down_bias = weights[f"{name}.down.weight"].T, weights[f"{name}.down.bias"]
        x = g.op("Add", x, g.linear(y, down * gate2, down_bias * gate2))
    x = with_emotion(x, config.layers)
    scale, shift = g.const(weights["norm.weight"]), g.const(weights["norm.bias"])
    x = g.op("LayerNormalization", x, scale, shift, epsilon=1e-5)
    x0 = g.linear(x, weights["output.weight"].T, weights["output.bias"])
    voice = g.const(np.ones((1, 1)))
    if config.direct_dim:
        x0, voice = _direct(g, x0, "heard", weights)
    x0 = with_emotion(x0, config.layers + 1)
    if config.contact:
        x0 = _contact(g, x0, "heard", voice, weights, config.reach_mm)
    g.rename(x0, "x0")
    g.rename(g.op("Concat", *row, axis=0), "row")
    heads, head_dim = config.heads, dim // config.heads
    cache, rope = [heads, config.window, head_dim], [3 * heads, 1, head_dim]
    names = [f"{kind}{i}" for kind in ("keys", "values") for i in range(config.layers)]
    inputs = {"inputs": [1, sum(config.input_dims)], **dict.fromkeys(names, cache)}
    inputs |= {"cos": rope, "sin": rope, "bias": [1, 1, config.window + 1]}
    if config.direct_dim or config.contact:
        inputs["heard"] = [1, config.contact_dim]
    if emotion:
        inputs["emotion"] = [1, int(places.sum())]
    new = [2 * heads * config.layers, 1, head_dim]
    return g.model(inputs, {"x0": [1, config.expression_dim], "row": new})
