"""The denoiser of one live tick, at tau = N: ONNX Runtime, without torch.

The graph (graph.py) is one frame of the network; this keeps its memory and its clock. Its twin in
torch is `Denoiser.step`. Whoever puts another denoiser here keeps `init_state` and `step`, and any
frozen state of its own. Paper section 4.3.
"""

from __future__ import annotations

import numpy as np

from encoder.denoiser.config import OUTPUT_GAIN, DenoiserConfig, ZeroConvConfig
from encoder.denoiser.graph import denoiser_model
from encoder.denoiser.past import Past
from encoder.nn.onnx_graph import Bits
from encoder.nn.onnx_session import session
from encoder.types import Floats, Weights

STALE = -1e9  # added to the score of a slot that holds no frame yet


DenoiserState = Past  # of LiveDenoiser; only this folder reads its fields


def not_live(config: DenoiserConfig) -> str | None:
    """Why the graph cannot express this denoiser, which then runs in torch; None if it can."""
    if config.attention != "softmax":
        return f"expected softmax attention, got {config.attention!r}"
    return None if config.causal else "expected a causal denoiser, got an offline one"


class LiveDenoiser:
    """Holds weights only. One stream, no batch axis."""

    def __init__(self, config: DenoiserConfig, weights: Weights, bits: Bits) -> None:
        self.config = config
        # Neutral, which is the usual, has a graph of its own, without what does nothing.
        self._neutral, self._moved = (
            session(denoiser_model(config, weights, bits, emotion=emotion))
            for emotion in (False, True)
        )
        half = config.dim // config.heads // 2
        self._rates = 10_000.0 ** (-np.arange(half) / half)
        self._still = np.zeros((2, 3 * config.heads, 1, 2, half), np.float32)  # cosines, sines
        self._still[0] = 1
        self._hears = bool(config.direct_dim or config.contact)

    def init_state(self) -> Past:
        c = self.config
        return Past.empty(c.layers, c.heads, c.window, c.dim // c.heads)

    def step(
        self,
        noise: Floats,  # [256] the frame at tau = N
        features: Floats,  # [A]
        condition: Floats,  # [condition_dim]
        state: Past,
        emotion: Floats | None = None,  # [2 sum(places)]; None: nothing
    ) -> tuple[Floats, Past]:
        """-> standardised code [256], the next state."""
        c, past = self.config, state.owned()
        bias = np.zeros((1, 1, c.window + 1), np.float32)
        bias[..., past.frame : c.window] = STALE
        inputs = {"inputs": np.concatenate([noise, features[: c.input_dims[1]], condition])[None]}
        inputs |= {"bias": bias} | self._rope(past.frame)
        for i in range(c.layers):
            inputs[f"keys{i}"], inputs[f"values{i}"] = past.ring.keys[i], past.ring.values[i]
        if self._hears:
            inputs["heard"] = features[None, -c.contact_dim :]
        if emotion is None:
            code, row = self._neutral.run(["x0", "row"], inputs)
        else:
            code, row = self._moved.run(["x0", "row"], inputs | {"emotion": emotion[None]})
        row = row.reshape(c.layers, 2, c.heads, -1)
        return code[0], past.followed_by(row[:, 0], row[:, 1])

    def _rope(self, frame: int) -> dict[str, Floats]:
        """What turns query and key, and leaves the value: [3 H, 1, D] each."""
        angles = np.remainder(frame * self._rates, 2 * np.pi)  # float64: exact after days
        rope, turned = self._still.copy(), 2 * self.config.heads
        rope[0, :turned] = np.cos(angles)
        rope[1, :turned] = np.sin(angles)
        rope[1, :turned, :, 0] *= -1
        cos, sin = rope.reshape(2, len(rope[0]), 1, -1)
        return {"cos": cos, "sin": sin}


def emotion_table(config: ZeroConvConfig, weights: Weights) -> Floats:  # [labels, width]
    """What each label does at full intensity. Twin: `ZeroConvs.table`."""
    rows, columns = weights["embeddings"], list[Floats]()
    for i in range(len(config.places)):
        for kind in ("shifts", "scales"):
            weight, bias = (weights[f"{kind}.{i}.{part}"] for part in ("weight", "bias"))
            columns.append(rows @ weight[:, :, 0].T + bias)
    columns[-2] = np.float32(OUTPUT_GAIN) * columns[-2]  # the shift after the output
    return np.concatenate(columns, 1)
