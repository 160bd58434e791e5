"""Runs the trained networks tick by tick: ONNX Runtime (int8, fp32) or PyTorch, one interface.

`load_driver` is what the app calls. The ONNX graphs are built in memory from the safetensors files,
so nothing is cached and nothing can go stale. One thread, spinning off: the other core draws
(FACTS: two spinning threads missed 201 of 210 ticks). Paper section 4.3.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from encoder import onnx_graph
from encoder.alignment import lerp_place, lerp_ready
from encoder.audio_encoder import AudioEncoder, AudioEncoderConfig
from encoder.checkpoint import config_from, load
from encoder.denoiser import Denoiser, DenoiserConfig
from encoder.resample import Resample
from sensors.types import SAMPLE_RATE, SAMPLES_PER_FRAME, InputError

if TYPE_CHECKING:
    from onnx import ModelProto

    from encoder.driver import Driver

Array = NDArray[np.float32]
BackendState = dict[str, Any]
BackendName = Literal["auto", "onnx-int8", "onnx", "torch"]
Condition = Literal["gaze", "eyes"]
WEIGHTS = Path(__file__).parent / "weights"
STUDENTS: dict[Condition, str] = {"gaze": "student", "eyes": "student_eyes"}


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
        self.name = "onnx-int8" if int8 else "onnx"
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
        self.shapes = onnx_graph.audio_shapes(self.audio_config)
        self.prior = weights.get("norms.0.prior")
        self.encoders = {
            n: session(onnx_graph.audio_model(self.audio_config, weights, n, int8)) for n in counts
        }
        weights = {name: tensor.numpy() for name, tensor in denoiser.state_dict().items()}
        self.denoiser = session(onnx_graph.denoiser_model(self.config, weights, int8))
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


def int8_is_exact() -> bool:
    """False on processors whose int8 products saturate (x86 without VNNI): use fp32 there."""
    graph = onnx_graph.Graph(int8=True)
    rows = onnx_graph.MIN_INT8_INPUTS
    graph.rename(graph.linear("x", np.ones((rows, 16)), np.zeros(16)), "y")
    runner = session(graph.model({"x": [1, rows]}, {"y": [1, 16]}))
    (y,) = runner.run(None, {"x": np.ones((1, rows), np.float32)})
    return bool(np.allclose(y, rows, rtol=0.01))


def load_models(
    weights_dir: Path | str | None = None, condition: Condition = "gaze"
) -> tuple[AudioEncoder, Denoiser, dict]:
    """Read audio and student checkpoints of a folder -> both networks and the student's card."""
    folder = WEIGHTS if weights_dir is None else Path(weights_dir)
    tensors, audio_card = load(folder / "audio", "audio")
    encoder = AudioEncoder(config_from(AudioEncoderConfig, audio_card["config"]))
    fill(encoder, tensors, folder / "audio")
    denoiser, card = load_student(folder, condition)
    if card.get("audio_sha256", audio_card["sha256"]) != audio_card["sha256"]:
        raise InputError(
            f"checkpoint {folder / 'student'}: expected the audio encoder it was trained with, got "
            "another; run `livedrive train distill` or restore both files"
        )
    return encoder.eval(), denoiser.eval(), card


def load_student(folder: Path, condition: Condition) -> tuple[Denoiser, dict]:
    """The student of a folder; one that sees may hold only what it learned beyond the other."""
    path = folder / STUDENTS[condition]
    tensors, card = load(path, "student")
    denoiser = Denoiser(config_from(DenoiserConfig, card["config"]))
    if tensors.keys() < denoiser.state_dict().keys():
        base, base_card = load(folder / STUDENTS["gaze"], "student")
        if card.get("audio_model", {}).get("sha256") != base_card["sha256"]:
            raise InputError(
                f"checkpoint {path}: expected the {STUDENTS['gaze']} beside it that it was made "
                "from, got another; run `livedrive train multimodal` or restore both files"
            )
        tensors = base | tensors
    fill(denoiser, tensors, path)
    return denoiser, card


def fill(module: AudioEncoder | Denoiser, tensors: dict[str, Any], path: Path) -> None:
    """load_state_dict whose errors are one line."""
    expected = {name: tensor.shape for name, tensor in module.state_dict().items()}
    got = {name: tensor.shape for name, tensor in tensors.items()}
    if expected != got:
        odd = sorted(k for k in expected.keys() | got.keys() if expected.get(k) != got.get(k))
        raise InputError(
            f"checkpoint {path}: expected the tensors of its config, got other names or shapes "
            f"({', '.join(odd[:3])}, ...); restore the file"
        )
    module.load_state_dict(tensors)


def create_backend(
    encoder: AudioEncoder, denoiser: Denoiser, backend: BackendName = "auto", device: str = "cpu"
) -> Backend:
    """auto: torch on a GPU or for linear attention, else int8 where it is exact, else fp32."""
    if backend == "auto":
        backend = "torch"
        if device == "cpu" and denoiser.config.attention == "softmax":
            backend = "onnx-int8" if int8_is_exact() else "onnx"
    if backend == "torch":
        return TorchBackend(encoder, denoiser, device)
    if backend not in ("onnx", "onnx-int8") or device != "cpu":
        raise InputError(
            f"backend: expected auto, torch, or onnx-int8 or onnx on the CPU, got {backend!r} on "
            f"{device!r}; use auto"
        )
    return OnnxBackend(encoder, denoiser, int8=backend == "onnx-int8")


def load_driver(
    weights_dir: Path | str | None = None,
    device: Literal["auto", "cpu", "cuda"] = "auto",
    backend: BackendName = "auto",
    condition: Condition = "gaze",
) -> Driver:
    """The trained Driver. Device "auto" is the GPU where PyTorch sees one."""
    import torch

    from encoder.driver import Driver
    from encoder.emotion import load_emotions
    from encoder.eye_encoder import load_eye_encoder

    if device == "auto":
        device = "cuda" if torch.cuda.is_available() and not backend.startswith("onnx") else "cpu"
    if device == "cuda" and not torch.cuda.is_available():
        raise InputError("device: expected a CUDA GPU, got none; use --device cpu")
    encoder, denoiser, card = load_models(weights_dir, condition)
    folder = WEIGHTS if weights_dir is None else Path(weights_dir)
    eyes = load_eye_encoder(folder) if condition == "eyes" else None
    # a student that sees is the audio model but for its first layers: the same emotions add to it
    # the same faces (smiles, brows: cosine of the codes' changes 0.997 and more)
    emotions = load_emotions(folder, card.get("audio_model", card)["sha256"])
    runner = create_backend(encoder, denoiser, backend, device)
    return Driver(runner, denoiser, eyes, emotions=emotions)


def choose_condition(wanted: Literal["auto", "gaze", "eyes"], has_eyes: bool) -> Condition:
    """auto: the eyes, where the source has pictures of them and their weights fit the others."""
    if wanted != "auto":
        return wanted
    return "eyes" if has_eyes and eyes_fit(WEIGHTS) else "gaze"


def eyes_fit(folder: Path) -> bool:
    """Are there an eye encoder and a student that sees, made from the gaze student beside them?"""
    cards: dict[str, Any] = {}
    for name in ("eyes", *STUDENTS.values()):
        path = folder / f"{name}.json"
        if not path.is_file():
            return False
        cards[name] = json.loads(path.read_text())
    seeing = cards[STUDENTS["eyes"]]
    return (
        seeing.get("audio_model", {}).get("sha256") == cards[STUDENTS["gaze"]]["sha256"]
        and seeing.get("eyes_sha256") == cards["eyes"]["sha256"]
    )
