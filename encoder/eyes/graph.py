"""The eye networks as ONNX graphs for ONNX Runtime, batch norms folded into the convolutions.

In float32 by measurement: on one core a pair takes 0.8 ms of CPU time, and 1.0 ms with int8
convolutions (QLinearConv), whose sums and paddings cost more than the small products save.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from encoder.eyes.format import FOUND, GAZE_UNIT, MEASURES, RIG, SIDE, EyeNetConfig
from encoder.nn.onnx_graph import Array, Graph
from encoder.types import Weights

if TYPE_CHECKING:
    from onnx import ModelProto


FINDER_STRIDES = (2, 2, 1, 2, 1)


def eye_model(config: EyeNetConfig, weights: Weights) -> ModelProto:
    """pixels [2, 1, 100, 100] -> features [2, 80], heads [2, 11]: gaze, lid, valid, rig; relative
    [2, 2] and together [2, 2]: gaze as calibration wants it, and as both pictures show it.
    """
    g = Graph(bits=None)
    flat = _convolved(g, weights, "", _strides(config))
    features = g.op("Tanh", _spread(g, flat, weights, "project", "spread"))
    scale = np.ones(4 + len(RIG))
    scale[:2] = GAZE_UNIT
    heads = g.linear(features, weights["heads.weight"].T * scale, weights["heads.bias"] * scale)
    relative = g.linear(features, weights["relative"][:-1], weights["relative"][-1])
    other = g.op("Gather", features, g.const(np.array([1, 0])), axis=0)
    pair = g.op("Concat", features, other, axis=1)
    for i, scale in ((0, 1.0), (2, GAZE_UNIT)):
        weight, bias = weights[f"pair.{i}.weight"].T * scale, weights[f"pair.{i}.bias"] * scale
        pair = g.linear(pair, weight, bias)
        pair = g.op("Tanh", pair) if i == 0 else pair
    own = g.op("Gather", heads, g.const(np.array([0, 1])), axis=1)
    outputs = {"features": features, "heads": heads, "relative": relative}
    for name, value in (outputs | {"together": g.op("Add", own, pair)}).items():
        g.rename(value, name)
    return g.model(
        {"pixels": [2, 1, SIDE, SIDE]},
        {
            "features": [2, config.features],
            "heads": [2, 4 + len(RIG)],
            "relative": [2, 2],
            "together": [2, 2],
        },
    )


def meter_model(config: EyeNetConfig, weights: Weights) -> ModelProto:
    """pixels [2, 1, 100, 100] -> measures [2, 8]: MEASURES."""
    g = Graph(bits=None)
    flat = _convolved(g, weights, "meter.", _strides(config))
    own = g.op("Relu", _spread(g, flat, weights, "meter.project", "meter.spread"))
    measures = g.linear(own, weights["meter.heads.weight"].T, weights["meter.heads.bias"])
    g.rename(measures, "measures")
    return g.model({"pixels": [2, 1, SIDE, SIDE]}, {"measures": [2, len(MEASURES)]})


def _strides(config: EyeNetConfig) -> tuple[int, ...]:
    return tuple(stride for _, _, stride in config.layers)


def finder_model(weights: Weights) -> ModelProto:
    """pixels [1, 1, 50, 50] -> found [1, 6]: FOUND."""
    g = Graph(bits=None)
    flat = _convolved(g, weights, "finder.", FINDER_STRIDES)
    hidden = g.op("Relu", _spread(g, flat, weights, "finder.project", "finder.spread"))
    found = g.linear(hidden, weights["finder.heads.weight"].T, weights["finder.heads.bias"])
    g.rename(found, "found")
    return g.model({"pixels": [1, 1, SIDE // 2, SIDE // 2]}, {"found": [1, len(FOUND)]})


def _convolved(g: Graph, weights: Weights, prefix: str, strides: tuple[int, ...]) -> str:
    """pixels -> [B, all]; a stride of 1 adds its input."""
    sides = [weights[f"{prefix}convs.{i}.weight"].shape[-1] for i in (0, 1)]
    # the finder's rows have an odd number of neighbours
    in_pairs = prefix != "finder." and strides[:2] == (2, 2) and sides == [5, 3]
    x = _first_two(g, weights, prefix) if in_pairs else "pixels"
    for i, stride in list(enumerate(strides))[2 if in_pairs else 0 :]:
        folded, bias = _folded(weights, prefix, i)
        kernel = folded.shape[-1]
        pads, shape = [kernel // 2] * 4, [kernel, kernel]
        parts = (g.const(folded), g.const(bias))
        y = g.op("Conv", x, *parts, kernel_shape=shape, strides=[stride] * 2, pads=pads)
        x = g.op("Relu", g.op("Add", y, x) if stride == 1 else y)
    return g.op("Flatten", x, axis=1)


def _first_two(g: Graph, weights: Weights, prefix: str) -> str:
    """Convolutions 5 x 5 and 3 x 3 of stride 2. The first gives two neighbours in a row side by
    side, as twice as many channels: as few as 8 leave half of a processor's width idle.
    """
    folded, bias = _folded(weights, prefix, 0)
    n = len(folded)
    two = np.zeros((2 * n, 1, 5, 7), np.float32)
    two[:n, :, :, :5] = two[n:, :, :, 2:] = folded
    parts = (g.const(two), g.const(np.concatenate([bias, bias])))
    y = g.op("Conv", "pixels", *parts, kernel_shape=[5, 7], strides=[2, 4], pads=[2, 2, 2, 1])
    folded, bias = _folded(weights, prefix, 1)
    of_two = np.zeros((len(folded), 2 * n, 3, 2), np.float32)
    of_two[:, n:, :, 0], of_two[:, :n, :, 1], of_two[:, n:, :, 1] = np.moveaxis(folded, 3, 0)
    parts = (g.const(of_two), g.const(bias))
    x = g.op("Relu", y)
    y = g.op("Conv", x, *parts, kernel_shape=[3, 2], strides=[2, 1], pads=[1, 1, 1, 0])
    return g.op("Relu", y)


def _spread(g: Graph, x: str, weights: Weights, linear: str, norm: str) -> str:
    """A linear layer with the batch norm that follows it."""
    spread = np.sqrt(weights[f"{norm}.running_var"] + 1e-5)
    shift = (weights[f"{linear}.bias"] - weights[f"{norm}.running_mean"]) / spread
    return g.linear(x, weights[f"{linear}.weight"].T / spread, shift)


def _folded(weights: Weights, prefix: str, i: int) -> tuple[Array, Array]:
    """Convolution i with its batch norm: weight [C', C, k, k], bias [C']."""
    name = f"{prefix}norms.{i}"
    scale = weights[f"{name}.weight"] / np.sqrt(weights[f"{name}.running_var"] + 1e-5)
    bias = weights[f"{name}.bias"] - weights[f"{name}.running_mean"] * scale
    return weights[f"{prefix}convs.{i}.weight"] * scale[:, None, None, None], bias
