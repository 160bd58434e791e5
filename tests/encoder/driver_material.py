"""Small networks, sound and frames: a Driver of one's own in a test."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from encoder.audio.config import PRESETS as AUDIO
from encoder.audio.config import AudioEncoderConfig
from encoder.audio.encoder import AudioEncoder
from encoder.backends import BackendName, Networks, create_backend
from encoder.denoiser.config import PRESETS as DENOISERS
from encoder.denoiser.model import Denoiser
from encoder.driver import Driver
from encoder.nn.checkpoint import arrays, save
from encoder.types import DriverState
from sensors.types import SensorFrame

WAV2VEC = AudioEncoderConfig(
    kind="wav2vec-large", sample_rate=16_000, feature_dim=0,
    layers=((16, 10, 5), (16, 8, 4), (16, 4, 2), (16, 4, 2), (16, 4, 2), (16, 1, 1), (16, 1, 1)),
    context=((2, 1), (3, 1), (13, 1)),
)  # fmt: skip
PAIR = replace(AUDIO["debug"], second=replace(AUDIO["phonetic-debug"], past_ticks=2))
BACKENDS: list[BackendName] = ["torch", "onnx", "onnx-int8"]


class StageNames:
    """A timer that keeps the names of the stages it saw."""

    def __init__(self) -> None:
        self.names: list[str] = []

    def __call__(self, stage: str) -> AbstractContextManager[None]:
        self.names.append(stage)
        return nullcontext()


def models(audio: AudioEncoderConfig = AUDIO["debug"]) -> tuple[AudioEncoder, Denoiser]:
    """Small networks without a zero gate or a default statistic that could hide an error."""
    torch.manual_seed(0)
    direct = audio.second.frame_width if audio.second else 0
    encoder = AudioEncoder(audio)
    sizes = replace(DENOISERS["debug"], audio_dim=audio.frame_width, direct_dim=direct, direct=6)
    denoiser = Denoiser(sizes)
    if denoiser.direct is not None:
        for tensor in denoiser.direct.state_dict().values():
            nn.init.normal_(tensor, std=0.1)
    for module in encoder.modules():
        if isinstance(module, nn.BatchNorm1d):
            nn.init.normal_(module.running_mean, std=0.05)  # type: ignore[arg-type]
            nn.init.uniform_(module.running_var, 0.02, 0.1)  # type: ignore[arg-type]
            nn.init.normal_(module.bias, std=0.2)
    for block in denoiser.blocks:
        nn.init.normal_(block.modulate.weight, std=0.05)
        nn.init.normal_(block.modulate.bias, std=0.3)
    denoiser.expression_mean.normal_()
    denoiser.expression_std.uniform_(0.5, 2)
    return encoder.eval(), denoiser.eval()


def networks(encoder: AudioEncoder, denoiser: Denoiser) -> Networks:
    """Modules as the live path takes them."""
    return Networks(
        encoder.config, arrays(encoder.state_dict()), denoiser.config, arrays(denoiser.state_dict())
    )


def driver_of(
    encoder: AudioEncoder, denoiser: Denoiser, backend: BackendName = "onnx", **more: Any
) -> Driver:
    made = networks(encoder, denoiser)
    mean, std = made.denoiser["expression_mean"], made.denoiser["expression_std"]
    return Driver(create_backend(made, backend), made.config, mean, std, **more)


def driver(backend: BackendName = "onnx", audio: AudioEncoderConfig = AUDIO["debug"]) -> Driver:
    return driver_of(*models(audio), backend)


def sound(frames: int, seed: int = 0) -> np.ndarray:
    draw = np.random.default_rng(seed)
    loudness = 0.1 * np.abs(np.sin(np.arange(frames) / 4))[:, None]
    return (loudness * draw.standard_normal((frames, 1600))).astype(np.float32)


def sensor_frame(index: int, audio: np.ndarray, gap: bool = False) -> SensorFrame:
    return SensorFrame(
        index=index, t_ns=index * 33_333_333, audio=audio, eyes=None, eyes_valid=np.zeros(2, bool),
        eyes_age_ns=np.zeros(2, np.int64), audio_gap=gap,
    )  # fmt: skip


def drive(
    d: Driver, audio: np.ndarray, state: DriverState | None = None, first: int = 0, seed: int = 5
) -> tuple[np.ndarray, np.ndarray, DriverState]:
    state = state or d.init_state(seed)
    codes, gaze = [], []
    for i, chunk in enumerate(audio):
        frame, state = d.step(sensor_frame(first + i, chunk), state)
        codes.append(frame.expression)
        gaze.append(frame.gaze)
    return np.array(codes), np.array(gaze), state


def write_weights(folder: Path) -> None:
    encoder, denoiser = models()
    save(
        folder / "audio", encoder.state_dict(), {"kind": "audio", "config": asdict(AUDIO["debug"])}
    )
    card = {"kind": "student", "config": asdict(denoiser.config)}
    save(folder / "student", denoiser.state_dict(), card)
