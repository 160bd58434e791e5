"""Eight bits: exact sums on any processor, and what they may cost on the shipped networks."""

import numpy as np
from onnx import numpy_helper

from encoder.backends import create_backend
from encoder.inference import load_networks
from encoder.nn.onnx_graph import Graph
from encoder.nn.onnx_session import eight_bits, session


def test_sums_of_eight_bits_are_exact_on_this_processor() -> None:
    """The largest products there are: in pairs they overflow 16 bits."""
    rng = np.random.default_rng(0)
    x = rng.choice([0.0, 255.0], (4, 128)).astype(np.float32)
    weight = rng.choice([-127.0, 127.0], (128, 32))
    graph = Graph(eight_bits())
    graph.rename(graph.linear("x", weight, np.zeros(32)), "y")
    runner = session(graph.model({"x": [4, 128]}, {"y": [4, 32]}))
    (y,) = runner.run(None, {"x": x})
    np.testing.assert_allclose(y, x @ weight, rtol=1e-5, atol=1)


def test_unsigned_weights_are_the_signed_ones() -> None:
    rng, found = np.random.default_rng(1), {}
    weight, bias = rng.standard_normal((64, 8)), rng.standard_normal(8)
    for bits in ("int8", "uint8"):
        graph = Graph(bits)
        graph.linear("x", weight, bias)
        made = {c.name: numpy_helper.to_array(c) for c in graph.constants}
        _, values, scale, zero, _ = graph.nodes[0].input
        found[bits] = (made[values].astype(int) - made.get(zero, 0)) * made[scale]
    np.testing.assert_array_equal(found["int8"], found["uint8"])
    np.testing.assert_allclose(found["int8"], weight, atol=np.abs(weight).max() / 254)


def test_int8_hears_what_lies_beside_a_click() -> None:
    """A key is struck once in a quiet room: the features of that tick keep their precision."""
    rng = np.random.default_rng(0)
    audio = rng.normal(0, 1e-3, (30, 1600)).astype(np.float32)
    audio[20, 800:] += 0.3 * rng.standard_normal(800) * np.exp(-np.arange(800) / 240)
    networks, _ = load_networks()
    found = {}
    for name in ("onnx", "onnx-int8"):
        backend = create_backend(networks, name)
        state, rows = backend.init_state(), []
        for tick in audio:
            features, state = backend.audio(tick, state)
            rows.append(features)
        found[name] = np.stack(rows)
    error = np.linalg.norm((found["onnx-int8"] - found["onnx"])[20:], axis=1)
    change = np.linalg.norm(found["onnx"][20:] - found["onnx"][10:20].mean(0), axis=1)
    assert (error / change).max() < 0.05
