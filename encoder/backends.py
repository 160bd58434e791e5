"""Backends that run the trained networks tick by tick: ONNX Runtime (int8, fp32) or PyTorch.

A backend joins the audio path and the denoiser of a stream; each keeps a frozen state of its own.
The ONNX graphs are built in memory from the weights, so nothing is cached and nothing can go
stale. One thread, spinning off, because the other core draws: two spinning threads missed 201 of
210 ticks. Paper section 4.3.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol, TypeVar

import numpy as np

from encoder.audio.config import AudioEncoderConfig
from encoder.denoiser.config import DenoiserConfig
from encoder.types import Floats, Weights
from sensors.types import InputError

if TYPE_CHECKING:
    from encoder.audio.encoder import AudioEncoder
    from encoder.audio.live import AudioState
    from encoder.denoiser.live import DenoiserState
    from encoder.denoiser.model import Denoiser
    from encoder.nn.streaming import State as TensorState

BackendName = Literal["auto", "onnx-int8", "onnx", "torch"]
State = TypeVar("State")


@dataclass(frozen=True, eq=False)
class Networks:
    """The trained audio encoder and student, as numbers."""

    audio_config: AudioEncoderConfig
    audio: Weights
    config: DenoiserConfig
    denoiser: Weights

    def modules(self) -> tuple[AudioEncoder, Denoiser]:
        """In torch, for a GPU, training and evaluation."""
        from encoder.audio.encoder import AudioEncoder
        from encoder.denoiser.model import Denoiser
        from encoder.nn.modules import fill

        encoder = fill(AudioEncoder(self.audio_config), self.audio, Path("audio"), "audio")
        return encoder, fill(Denoiser(self.config), self.denoiser, Path("student"), "student")


class Backend(Protocol[State]):
    """One stream, no batch axis. States are values; see DriverState."""

    name: str

    def init_state(self) -> State: ...

    def audio(self, audio: Floats, state: State) -> tuple[Floats, State]:
        """audio [1600] at 48 kHz -> audio_features [A]."""
        ...

    def denoise(
        self,
        noise: Floats,  # [256] the frame at tau = N
        features: Floats,  # [A]
        condition: Floats,  # [condition_dim]
        state: State,
        emotion: Floats | None = None,  # [width] of Emotions.step; None: nothing
    ) -> tuple[Floats, State]:
        """-> standardised code [256].

        The denoiser's `step` (denoiser/live.py) with the state of the whole stream: written out in
        both, because type checkers compare a protocol with what keeps it argument by argument.
        """
        ...


@dataclass(frozen=True, eq=False)
class OnnxState:
    audio: AudioState
    past: DenoiserState


class OnnxBackend:
    """ONNX Runtime on one thread, without torch."""

    def __init__(self, networks: Networks, *, int8: bool) -> None:
        from encoder.audio.live import LiveAudio
        from encoder.denoiser.live import LiveDenoiser
        from encoder.nn.onnx_session import eight_bits

        self.name, bits = ("onnx-int8", eight_bits()) if int8 else ("onnx", None)
        self._audio = LiveAudio(networks.audio_config, networks.audio, bits)
        self._denoiser = LiveDenoiser(networks.config, networks.denoiser, bits)

    def init_state(self) -> OnnxState:
        return OnnxState(self._audio.init_state(), self._denoiser.init_state())

    def audio(self, audio: Floats, state: OnnxState) -> tuple[Floats, OnnxState]:
        features, after = self._audio.step(audio, state.audio)
        return features, OnnxState(after, state.past)

    def denoise(
        self, noise: Floats, features: Floats, condition: Floats, state: OnnxState,
        emotion: Floats | None = None,
    ) -> tuple[Floats, OnnxState]:  # fmt: skip
        code, after = self._denoiser.step(noise, features, condition, state.past, emotion)
        return code, OnnxState(state.audio, after)


@dataclass(frozen=True, eq=False)
class TorchState:
    audio: TensorState
    past: TensorState


class TorchBackend:
    """The modules themselves: the reference, and the path to a GPU."""

    name = "torch"

    def __init__(self, networks: Networks, device: str) -> None:
        import torch

        from encoder.audio.alignment import AudioFeatures

        if device == "cpu":
            torch.set_num_threads(1)
        self._device = torch.device(device)
        encoder, denoiser = networks.modules()
        self._features = AudioFeatures(encoder).eval().to(self._device)
        self._denoiser = denoiser.to(self._device)
        self._tau = torch.tensor([networks.config.num_steps], device=self._device)

    def init_state(self) -> TorchState:
        return TorchState(self._features.init_state(1), self._denoiser.init_state(1))

    def _tensor(self, array: Floats, *shape: int) -> Any:
        import torch

        return torch.from_numpy(np.ascontiguousarray(array)).reshape(shape).to(self._device)

    def audio(self, audio: Floats, state: TorchState) -> tuple[Floats, TorchState]:
        import torch

        with torch.inference_mode():
            y, after = self._features.step(self._tensor(audio, 1, -1, 1), state.audio)
        return y[0, 0].cpu().numpy(), TorchState(after, state.past)

    def denoise(
        self, noise: Floats, features: Floats, condition: Floats, state: TorchState,
        emotion: Floats | None = None,
    ) -> tuple[Floats, TorchState]:  # fmt: skip
        import torch

        x, a, g = (self._tensor(x, 1, 1, -1) for x in (noise, features, condition))
        added = None if emotion is None else self._tensor(emotion, 1, -1)
        with torch.inference_mode():
            y, after = self._denoiser.step(x, self._tau, a, g, state.past, emotion=added)
        return y[0, 0].cpu().numpy(), TorchState(state.audio, after)


def create_backend(
    networks: Networks, backend: BackendName = "auto", device: str = "cpu"
) -> Backend[Any]:
    """auto: torch on a GPU or for what the ONNX graph cannot express, else int8."""
    from encoder.denoiser.live import not_live

    refusal = not_live(networks.config)
    if backend == "auto":
        backend = "onnx-int8" if device == "cpu" and refusal is None else "torch"
    if backend == "torch":
        return TorchBackend(networks, device)
    if backend not in ("onnx", "onnx-int8") or device != "cpu":
        raise InputError(
            f"backend: expected auto, torch, or onnx-int8 or onnx on the CPU, got {backend!r} on "
            f"{device!r}; use auto"
        )
    if refusal is not None:
        raise InputError(f'backend {backend}: {refusal}; use backend "torch"')
    return OnnxBackend(networks, int8=backend == "onnx-int8")
