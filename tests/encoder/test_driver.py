"""The Driver from raw samples: causal to the bit, streaming, repeatable, equal on all backends."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import nn

from encoder.audio_encoder import PRESETS as AUDIO
from encoder.audio_encoder import AudioEncoder, AudioEncoderConfig
from encoder.backends import BackendName, create_backend
from encoder.checkpoint import save
from encoder.denoiser import PRESETS as DENOISERS
from encoder.denoiser import Denoiser
from encoder.diffusion import frame_noise
from encoder.driver import Driver, DriverState
from encoder.inference import load_driver
from sensors.types import InputError, SensorFrame

WAV2VEC = AudioEncoderConfig(
    kind="wav2vec-large", sample_rate=16_000, feature_dim=0,
    layers=((16, 10, 5), (16, 8, 4), (16, 4, 2), (16, 4, 2), (16, 4, 2), (16, 1, 1), (16, 1, 1)),
    context=((2, 1), (3, 1), (13, 1)),
)  # fmt: skip
BACKENDS: list[BackendName] = ["torch", "onnx", "onnx-int8"]


def models(audio: AudioEncoderConfig = AUDIO["debug"]) -> tuple[AudioEncoder, Denoiser]:
    """Small networks without a zero gate or a default statistic that could hide an error."""
    torch.manual_seed(0)
    audio_dim = 512 if audio.kind == "compact" else 16
    encoder = AudioEncoder(audio)
    denoiser = Denoiser(replace(DENOISERS["debug"], audio_dim=audio_dim))
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


def driver(backend: BackendName = "onnx", audio: AudioEncoderConfig = AUDIO["debug"]) -> Driver:
    encoder, denoiser = models(audio)
    return Driver(create_backend(encoder, denoiser, backend), denoiser)


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


@pytest.mark.parametrize("backend", BACKENDS)
def test_future_changes_nothing(backend: BackendName) -> None:
    d, audio = driver(backend), sound(40)
    expected, gaze, _ = drive(d, audio)
    assert expected.dtype == gaze.dtype == np.float32 and expected.shape == (40, 256)
    for junk in (np.nan, 0.9):
        changed = audio.copy()
        changed[25:] = junk
        actual, _, _ = drive(d, changed)
        assert np.array_equal(actual[:25], expected[:25])
        assert not np.array_equal(actual[25:], expected[25:])  # the newest frame does hear it


@pytest.mark.parametrize("backend", BACKENDS)
def test_sound_and_noise_are_heard(backend: BackendName) -> None:
    d, audio = driver(backend), sound(10)
    codes, _, _ = drive(d, audio)
    other, _, _ = drive(d, sound(10, seed=1))
    reseeded, _, _ = drive(d, audio, seed=6)
    assert np.abs(codes - other).max() > 1e-3 and np.abs(codes - reseeded).max() > 1e-3
    assert np.array_equal(drive(d, audio)[0], codes)


@pytest.mark.parametrize("audio_config", [AUDIO["debug"], WAV2VEC], ids=["compact", "wav2vec"])
def test_onnx_equals_torch_for_300_frames(audio_config: AudioEncoderConfig) -> None:
    audio = sound(300)
    expected, gaze, _ = drive(driver("torch", audio_config), audio)
    actual, same_gaze, _ = drive(driver("onnx", audio_config), audio)
    assert np.abs(actual - expected).max() < 2e-5 * np.abs(expected).max()
    assert np.array_equal(gaze, same_gaze)
    codes, _, _ = drive(driver("onnx-int8", audio_config), audio)
    error = np.linalg.norm(codes - expected, axis=1) / np.linalg.norm(expected, axis=1)
    assert 0 < error.mean() < 0.05  # 0 would mean that nothing was quantised
    assert error[-50:].mean() < 1.5 * error[25:75].mean()  # and it does not grow


def test_a_condition_of_other_size_costs_the_rest_no_precision() -> None:
    """Plain gaze has weights ten times the others': one int8 scale for all would drown those."""
    encoder, denoiser = models()
    with torch.no_grad():
        denoiser.input.weight[:, -6:] *= 100
        denoiser.input.bias -= denoiser.input.weight[:, -6:] @ torch.tensor([0, 0, 1.0] * 2)
    found = {
        name: drive(Driver(create_backend(encoder, denoiser, name), denoiser), sound(60))[0]
        for name in ("onnx", "onnx-int8")
    }
    error = np.linalg.norm(found["onnx-int8"] - found["onnx"], axis=1)
    assert error.mean() < 0.05 * np.linalg.norm(found["onnx"], axis=1).mean()


def test_streaming_equals_the_whole_sequence() -> None:
    """300 ticks against one offline pass of the modules: features, noise, mask, standardisation."""
    from encoder.alignment import AudioFeatures

    encoder, denoiser = models()
    audio = sound(300)
    codes, gaze, _ = drive(driver("torch"), audio)
    noise = np.stack([frame_noise(5, i, 256) for i in range(300)])
    with torch.no_grad():
        features = AudioFeatures(encoder).eval()(torch.from_numpy(audio).reshape(1, -1, 1))
        condition = torch.from_numpy(gaze).reshape(1, 300, 6)
        tau = torch.tensor([200])
        x0 = denoiser(torch.from_numpy(noise)[None], tau, features, condition)
        expected = denoiser.unstandardise(x0)[0].numpy()
    assert np.abs(codes - expected).max() < 1e-5 * max(1, np.abs(expected).max())


@pytest.mark.parametrize("backend", BACKENDS)
def test_resumes_from_its_state_and_never_writes_it(backend: BackendName) -> None:
    d, audio = driver(backend), sound(60)
    whole, _, _ = drive(d, audio)
    first, _, state = drive(d, audio[:31])
    drive(d, sound(40, seed=9), state, 31)  # another future of the same state
    rest, _, _ = drive(d, audio[31:], state, 31)
    assert np.array_equal(np.concatenate([first, rest]), whole)


@pytest.mark.parametrize("backend", ["torch", "onnx"])
def test_stale_cache_is_never_read(backend: BackendName) -> None:
    d, audio = driver(backend), sound(40)
    expected, _, _ = drive(d, audio)
    state = d.init_state(5)
    memory = dict(state.backend)
    past = dict(memory["past"]) if backend == "torch" else memory
    past["keys"], past["values"] = past["keys"] * np.nan, past["values"] * np.nan
    memory = {**memory, "past": past} if backend == "torch" else past
    actual, _, _ = drive(d, audio, replace(state, backend=memory))
    assert np.array_equal(actual, expected)


@pytest.mark.parametrize("backend", ["torch", "onnx"])
def test_four_days_change_nothing(backend: BackendName) -> None:
    """Only relative positions count, so frame 10 000 000 must act like frame 1000."""
    d, audio, results = driver(backend), sound(30), []
    for frame in (1000, 10_000_000):
        state = d.init_state(5)
        count = torch.tensor(frame)
        memory = {**state.backend, "frame": frame}
        if backend == "torch":
            memory = {**state.backend, "past": {**state.backend["past"], "frame": count}}
        results.append(drive(d, audio, replace(state, backend=memory))[0])
    assert np.abs(results[0] - results[1]).max() < 1e-5 * np.abs(results[0]).max()


def test_a_gap_is_driven_as_silence() -> None:
    d, audio = driver(), sound(20)
    audio[8:12] = 0
    expected, _, _ = drive(d, audio)
    state, codes = d.init_state(5), []
    for i, chunk in enumerate(audio):
        frame, state = d.step(sensor_frame(i, chunk, gap=8 <= i < 12), state)
        codes.append(frame.expression)
    assert np.array_equal(np.array(codes), expected) and np.isfinite(expected).all()


def test_long_silence_stays_finite() -> None:
    codes, _, _ = drive(driver(), np.zeros((400, 1600), np.float32))
    assert np.isfinite(codes).all() and np.abs(codes).max() < 100


def test_timer_sees_the_stages() -> None:
    names = []

    @contextmanager
    def timer(stage: str) -> Iterator[None]:
        names.append(stage)
        yield

    d = driver()
    d.step(sensor_frame(0, sound(1)[0]), d.init_state(0), timer)
    assert names == ["audio", "gaze", "denoise"]


def write_weights(folder: Path) -> None:
    encoder, denoiser = models()
    save(
        folder / "audio", encoder.state_dict(), {"kind": "audio", "config": asdict(AUDIO["debug"])}
    )
    card = {"kind": "student", "config": asdict(denoiser.config)}
    save(folder / "student", denoiser.state_dict(), card)


def test_load_driver(tmp_path: Path) -> None:
    write_weights(tmp_path)
    loaded = load_driver(tmp_path, device="cpu")
    assert loaded.backend.name == "onnx-int8"
    expected, _, _ = drive(driver("onnx"), sound(5))
    actual, _, _ = drive(load_driver(tmp_path, device="cpu", backend="onnx"), sound(5))
    assert np.array_equal(actual, expected)


def test_bad_weights_are_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="expected a .safetensors"):
        load_driver(tmp_path, device="cpu")
    write_weights(tmp_path)
    encoder, _ = models()
    tensors = dict(encoder.state_dict())
    del tensors["convs.2.weight"]
    save(tmp_path / "audio", tensors, {"kind": "audio", "config": asdict(AUDIO["debug"])})
    with pytest.raises(InputError, match="convs.2.weight"):
        load_driver(tmp_path, device="cpu")
    with pytest.raises(InputError, match="use auto"):
        create_backend(*models(), backend="tensorrt")  # type: ignore[arg-type]
    denoiser = Denoiser(replace(DENOISERS["debug"], attention="linear"))
    with pytest.raises(InputError, match="softmax"):
        create_backend(encoder, denoiser, backend="onnx")
    eyes = Denoiser(replace(DENOISERS["debug"], condition="eyes", condition_dim=160))
    with pytest.raises(InputError, match="--condition eyes"):
        Driver(create_backend(encoder, eyes, "onnx"), eyes)
