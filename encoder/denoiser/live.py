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
        self._session = session(denoiser_model(config, weights, bits))
        half = config.dim // config.heads // 2
        self._rates = 10_000.0 ** (-np.arange(half) / half)
        self._hears = bool(config.direct_dim or config.contact)
        kinds = [np.full(width, factor) for width in config.places for factor in (0, 1)]
        self._calm = np.concatenate(kinds)[None].astype(np.float32)

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
        angles = np.remainder(past.frame * self._rates, 2 * np.pi)  # float64: exact after days
        cos, sin = np.cos(angles).astype(np.float32), np.sin(angles).astype(np.float32)
        own = features[: c.input_dims[1]]
        inputs = {
            "inputs": np.concatenate([noise, own, condition])[None],
            "cos": np.concatenate([cos, cos])[None, None],
            "sin": np.concatenate([-sin, sin])[None, None],
            "bias": bias,
            "emotion": self._calm if emotion is None else self._calm + emotion,
        }
        if self._hears:
            inputs["heard"] = features[None, -c.contact_dim :]
        for i in range(c.layers):
            inputs[f"keys{i}"], inputs[f"values{i}"] = past.ring.keys[i], past.ring.values[i]
        code, key, value = self._session.run(["x0", "key", "value"], inputs)
        shape = (c.layers, c.heads, -1)
        return code[0], past.followed_by(key.reshape(shape), value.reshape(shape))


def emotion_table(config: ZeroConvConfig, weights: Weights) -> Floats:  # [labels, width]
    """What each label does at full intensity. Twin: `ZeroConvs.table`."""
    rows, columns = weights["embeddings"], list[Floats]()
    for i in range(len(config.places)):
        for kind in ("shifts", "scales"):
            weight, bias = (weights[f"{kind}.{i}.{part}"] for part in ("weight", "bias"))
            columns.append(rows @ weight[:, :, 0].T + bias)
    columns[-2] = np.float32(OUTPUT_GAIN) * columns[-2]  # the shift after the output
    return np.concatenate(columns, 1)
