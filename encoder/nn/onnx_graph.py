"""A builder of ONNX graphs: one tick of a network (graph.py of audio, denoiser and eyes).

Constants are folded by the caller. Weights have 8 bits with one scale for each column, activations
are quantised at run time (paper section 4.3).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from onnx import ModelProto

Array = NDArray[Any]
# Type of the weights in products: signed, or the same plus 128 (onnx_session.eight_bits); None:
# float32.
Bits = Literal["int8", "uint8"] | None
MIN_INT8_INPUTS = 64  # shorter products gain nothing and lose accuracy


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
        zero, where = 0, ""  # a zero point would make signed products a twentieth slower
        if self.bits == "uint8":
            zero, where = 128, self.const(np.array(128, np.uint8))
        quantised = (np.rint(weight / scale) + zero).astype(self.bits)
        names = [self.const(quantised), self.const(scale), where, self.const(bias)]
        return self.op("DynamicQuantizeMatMul", x, *names, domain="com.microsoft")

    def rename(self, name: str, output: str) -> None:
        """A value that a node has computed becomes an output of the graph."""
        for node in self.nodes:
            for names in (node.input, node.output):
                names[:] = [output if own == name else own for own in names]

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
