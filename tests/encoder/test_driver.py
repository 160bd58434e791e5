"""The Driver from raw samples: causal to the bit, streaming, repeatable, equal on all backends."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
import torch
from driver_material import (
    BACKENDS,
    PAIR,
    WAV2VEC,
    StageNames,
    drive,
    driver,
    driver_of,
    models,
    networks,
    sensor_frame,
    sound,
    write_weights,
)

from encoder.audio.config import PRESETS as AUDIO
from encoder.audio.config import AudioEncoderConfig
from encoder.backends import BackendName, create_backend
from encoder.denoiser.config import PRESETS as DENOISERS
from encoder.denoiser.model import Denoiser
from encoder.driver import frame_noise
from encoder.inference import load_driver
from encoder.nn.checkpoint import save
from sensors.types import InputError


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


@pytest.mark.parametrize(
    "audio_config",
    [
        pytest.param(AUDIO["debug"], id="compact"),
        pytest.param(WAV2VEC, id="wav2vec", marks=pytest.mark.slow),
        pytest.param(PAIR, id="pair", marks=pytest.mark.slow),
    ],
)
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
        name: drive(driver_of(encoder, denoiser, name), sound(60))[0]
        for name in ("onnx", "onnx-int8")
    }
    error = np.linalg.norm(found["onnx-int8"] - found["onnx"], axis=1)
    assert error.mean() < 0.05 * np.linalg.norm(found["onnx"], axis=1).mean()


def test_streaming_equals_the_whole_sequence() -> None:
    """300 ticks against one offline pass of the modules: features, noise, mask, standardisation."""
    from encoder.audio.alignment import AudioFeatures

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


@pytest.mark.slow
@pytest.mark.parametrize("backend", BACKENDS)
def test_every_state_may_be_kept_and_stepped_from_again(backend: BackendName) -> None:
    """The K/V ring is written in place, so this is what could go wrong, within and past a block."""
    d, audio = driver(backend), sound(80)
    whole, _, _ = drive(d, audio)
    states, state = [], d.init_state(5)
    for i, chunk in enumerate(audio):
        states.append(state)
        _, state = d.step(sensor_frame(i, chunk), state)
    for start in (0, 1, 24, 25, 26, 49, 50, 51, 79):
        for _ in range(2):
            rest, _, _ = drive(d, audio[start:], states[start], start)
            assert np.array_equal(rest, whole[start:])
    drive(d, sound(30, seed=3), states[30], 30)
    assert np.array_equal(drive(d, audio[30:], states[30], 30)[0], whole[30:])


def test_the_live_path_needs_no_torch(tmp_path: Path) -> None:
    write_weights(tmp_path)
    code = (
        "import sys; from encoder.inference import load_driver; "
        f"load_driver({str(tmp_path)!r}, 'cpu').init_state(0); print('torch' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


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
    d, timer = driver(), StageNames()
    d.step(sensor_frame(0, sound(1)[0]), d.init_state(0), timer)
    assert timer.names == ["audio", "gaze", "denoise"]


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
        create_backend(networks(*models()), backend="tensorrt")  # type: ignore[arg-type]
    denoiser = Denoiser(replace(DENOISERS["debug"], attention="linear"))
    with pytest.raises(InputError, match="softmax"):
        create_backend(networks(encoder, denoiser), backend="onnx")
    eyes = Denoiser(replace(DENOISERS["debug"], condition="eyes", condition_dim=160))
    with pytest.raises(InputError, match="--condition eyes"):
        driver_of(encoder, eyes)
