"""Runs the trained networks tick by tick: ONNX Runtime (int8, fp32) or PyTorch, one interface.

The ONNX graphs are built in memory from the networks, so nothing is cached and nothing can go
stale. One thread, spinning off: the other core draws (FACTS: two spinning threads missed 201 of
210 ticks). Paper section 4.3.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from encoder import audio_graph, denoiser_graph, onnx_graph
from encoder.alignment import lerp_place, lerp_ready
from encoder.audio_encoder import AudioEncoder
from encoder.denoiser import Denoiser
from encoder.resample import Resample
from sensors.types import SAMPLE_RATE, SAMPLES_PER_FRAME, InputError

if TYPE_CHECKING:
    from onnx import ModelProto

Array = NDArray[np.float32]
BackendState = dict[str, Any]
BackendName = Literal["auto", "onnx-int8", "onnx", "torch"]


class Backend(Protocol):
    """One stream, no batch axis. States are values: never written into after they were returned."""

    name: str

    def init_state(self) -> BackendState: ...

    def audio(self, audio: Array, state: BackendState) -> tuple[Array, BackendState]:
        """audio [1600] at 48 kHz -> audio_features [A]."""
        ...

    def denoise(
        self, noise: Array, features: Array, condition: Array, state: BackendState,
        emotion: Array | None = None,
    ) -> tuple[Array, BackendState]:  # fmt: skip
        """noise [256] at tau = N, features [A], condition [6], emotion [width] or none ->
        standardised code [256]."""
        ...


class TorchBackend:
    """The modules themselves: the reference, and the path to a GPU."""

    name = "torch"

    def __init__(self, encoder: AudioEncoder, denoiser: Denoiser, device: str) -> None:
        import torch

        from encoder.alignment import AudioFeatures

        if device == "cpu":
            torch.set_num_threads(1)
        self.device = torch.device(device)
        self.features = AudioFeatures(encoder).eval().to(self.device)
        self.denoiser = denoiser.eval().to(self.device)
        self.tau = torch.tensor([denoiser.config.num_steps], device=self.device)

    def init_state(self) -> BackendState:
        return {"audio": self.features.init_state(1), "past": self.denoiser.init_state(1)}

    def _tensor(self, array: Array, *shape: int) -> Any:
        import torch

        return torch.from_numpy(np.ascontiguousarray(array)).reshape(shape).to(self.device)

    def audio(self, audio: Array, state: BackendState) -> tuple[Array, BackendState]:
        import torch

        with torch.inference_mode():
            y, after = self.features.step(self._tensor(audio, 1, -1, 1), state["audio"])
        return y[0, 0].cpu().numpy(), {**state, "audio": after}

    def denoise(
        self, noise: Array, features: Array, condition: Array, state: BackendState,
        emotion: Array | None = None,
    ) -> tuple[Array, BackendState]:  # fmt: skip
        import torch

        x, a, g = (self._tensor(x, 1, 1, -1) for x in (noise, features, condition))
        added = None if emotion is None else self._tensor(emotion, 1, -1)
        with torch.inference_mode():
            y, after = self.denoiser.step(x, self.tau, a, g, state["past"], emotion=added)
        return y[0, 0].cpu().numpy(), {**state, "past": after}


def session(model: ModelProto) -> Any:
    """An ONNX Runtime session on one thread that does not spin."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.add_session_config_entry("session.set_denormal_as_zero", "1")
    options.log_severity_level = 3
    return onnxruntime.InferenceSession(
        model.SerializeToString(), options, providers=["CPUExecutionProvider"]
    )


class OnnxBackend:
    """ONNX Runtime on one thread; resampling, alignment and the ring cache in numpy around it."""

    def __init__(self, encoder: AudioEncoder, denoiser: Denoiser, *, int8: bool) -> None:
        self.name, bits = ("onnx-int8", eight_bits()) if int8 else ("onnx", None)
        self.audio_config, self.config = encoder.config, denoiser.config
        if self.config.attention != "softmax":
            raise InputError(
                f"backend {self.name}: expected softmax attention, got {self.config.attention!r}; "
                'use backend "torch"'
            )
        self.factor = SAMPLE_RATE // self.audio_config.sample_rate
        self.stride = self.audio_config.stride
        resample = Resample(self.factor)
        self.kernel = resample.kernel.numpy().reshape(-1)
        self.context = resample.context
        tick = SAMPLES_PER_FRAME / self.factor / self.stride  # features a tick
        self.stacked = int(tick) if tick.is_integer() else 0
        counts = {int(tick), -int(-tick // 1)}
        weights = {name: tensor.numpy() for name, tensor in encoder.state_dict().items()}
        self.shapes = audio_graph.audio_shapes(self.audio_config)
        self.prior = weights.get("norms.0.prior")
        self.encoders = {
            n: session(audio_graph.audio_model(self.audio_config, weights, n, bits)) for n in counts
        }
        weights = {name: tensor.numpy() for name, tensor in denoiser.state_dict().items()}
        self.denoiser = session(denoiser_graph.denoiser_model(self.config, weights, bits))
        half = self.config.dim // self.config.heads // 2
        self.rates = 10_000.0 ** (-np.arange(half) / half)
        self.calm = np.zeros((1, 2 * sum(self.config.places)), np.float32)

    def init_state(self) -> BackendState:
        c = self.config
        audio = {name: np.zeros(shape, np.float32) for name, shape in self.shapes.items()}
        if self.prior is not None:
            audio["statistics"] = self.prior.reshape(1, 2)
        empty = np.zeros((c.layers, c.heads, c.window, c.dim // c.heads), np.float32)
        return {
            "raw": np.zeros(self.context, np.float32),  # 48 kHz, still under the filter
            "pending": np.zeros(0, np.float32),  # resampled, not yet a whole feature
            "audio": audio,
            "tail": np.zeros((0, self.audio_config.width), np.float32),
            "count": 0,  # features so far
            "keys": empty,
            "values": empty,
            "frame": 0,
        }

    def audio(self, audio: Array, state: BackendState) -> tuple[Array, BackendState]:
        raw = np.concatenate([state["raw"], audio])
        ready = (len(raw) - self.context) // self.factor
        windows = np.lib.stride_tricks.sliding_window_view(raw, len(self.kernel))
        sound = np.concatenate([state["pending"], windows[:: self.factor][:ready] @ self.kernel])
        num = len(sound) // self.stride
        sound, pending = sound[: num * self.stride], sound[num * self.stride :]
        features, *after = self.encoders[num].run(None, {"audio": sound[:, None], **state["audio"]})
        names = [output.name.removesuffix("_next") for output in self.encoders[num].get_outputs()]
        state = {
            **state,
            "raw": raw[ready * self.factor :],
            "pending": pending,
            "audio": dict(zip(names[1:], after, strict=True)),
            "count": state["count"] + num,
        }
        if self.stacked:
            return features.reshape(-1), state
        features = np.concatenate([state["tail"], features])[-8:]
        left, weight = lerp_place(lerp_ready(state["count"]) - 1)
        place = left - (state["count"] - len(features))
        pair = features[place : place + 2]
        mixed = pair[0] + np.float32(weight) * (pair[-1] - pair[0])
        return mixed, {**state, "tail": features}

    def denoise(
        self, noise: Array, features: Array, condition: Array, state: BackendState,
        emotion: Array | None = None,
    ) -> tuple[Array, BackendState]:  # fmt: skip
        frame, window = state["frame"], self.config.window
        keys, values = state["keys"], state["values"]
        bias = np.zeros((1, 1, window + 1), np.float32)
        if frame < window:  # stale slots may hold anything, even NaN
            bias[..., frame:window] = -1e9
            fresh = (np.arange(window) < frame)[:, None]
            keys, values = np.where(fresh, keys, 0), np.where(fresh, values, 0)
        angles = np.remainder(frame * self.rates, 2 * np.pi)  # float64
        angles = np.concatenate([angles, angles])[None, None]
        code, key, value = self.denoiser.run(
            ["x0", "key", "value"],
            {
                "inputs": np.concatenate([noise, features, condition])[None],
                "keys": keys,
                "values": values,
                "cos": np.cos(angles).astype(np.float32),
                "sin": np.sin(angles).astype(np.float32),
                "bias": bias,
                "emotion": self.calm if emotion is None else emotion[None],
            },
        )
        keys, values = keys.copy(), values.copy()
        keys[:, :, frame % window], values[:, :, frame % window] = key, value
        return code[0], {**state, "keys": keys, "values": values, "frame": frame + 1}


@cache
def eight_bits() -> onnx_graph.Bits:
    """Signed weights, or unsigned ones where products with signed ones saturate (x86 without VNNI).

    Both give the same sums, and so the same codes on either processor.
    """
    graph = onnx_graph.Graph("int8")
    rows = onnx_graph.MIN_INT8_INPUTS
    graph.rename(graph.linear("x", np.ones((rows, 16)), np.zeros(16)), "y")
    runner = session(graph.model({"x": [1, rows]}, {"y": [1, 16]}))
    (y,) = runner.run(None, {"x": np.ones((1, rows), np.float32)})
    return "int8" if np.allclose(y, rows, rtol=0.01) else "uint8"


def create_backend(
    encoder: AudioEncoder, denoiser: Denoiser, backend: BackendName = "auto", device: str = "cpu"
) -> Backend:
    """auto: torch on a GPU or for linear attention, else int8."""
    if backend == "auto":
        backend = "torch"
        if device == "cpu" and denoiser.config.attention == "softmax":
            backend = "onnx-int8"
    if backend == "torch":
        return TorchBackend(encoder, denoiser, device)
    if backend not in ("onnx", "onnx-int8") or device != "cpu":
        raise InputError(
            f"backend: expected auto, torch, or onnx-int8 or onnx on the CPU, got {backend!r} on "
            f"{device!r}; use auto"
        )
    return OnnxBackend(encoder, denoiser, int8=backend == "onnx-int8")
