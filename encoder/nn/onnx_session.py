"""ONNX Runtime sessions: the only module that imports onnxruntime, with its telemetry off.

Official builds of ONNX Runtime send usage events to Microsoft and keep a device id under
~/.cache/Microsoft. They read the switch once, while the library loads.
"""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from encoder.nn.onnx_graph import MIN_INT8_INPUTS, Bits, Graph

if TYPE_CHECKING:
    from onnx import ModelProto


def session(model: ModelProto | Path) -> Any:
    """An ONNX Runtime session of a model or a file, on one thread that does not spin."""
    os.environ["ORT_DISABLE_TELEMETRY"] = "1"  # before the import, whatever the user has set
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.add_session_config_entry("session.set_denormal_as_zero", "1")
    options.log_severity_level = 3
    source = str(model) if isinstance(model, Path) else model.SerializeToString()
    return onnxruntime.InferenceSession(source, options, providers=["CPUExecutionProvider"])


@cache
def eight_bits() -> Bits:
    """Signed weights, or unsigned ones where products with signed ones saturate (x86 without VNNI).

    Both give the same sums, and so the same codes on either processor.
    """
    graph = Graph("int8")
    graph.rename(graph.linear("x", np.ones((MIN_INT8_INPUTS, 16)), np.zeros(16)), "y")
    runner = session(graph.model({"x": [1, MIN_INT8_INPUTS]}, {"y": [1, 16]}))
    (y,) = runner.run(None, {"x": np.ones((1, MIN_INT8_INPUTS), np.float32)})
    return "int8" if np.allclose(y, MIN_INT8_INPUTS, rtol=0.01) else "uint8"
