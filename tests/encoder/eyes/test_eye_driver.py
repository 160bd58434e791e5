"""The Driver with eyes as its condition: causal, repeatable, alive when the cameras die."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path

import driver_material
import numpy as np
import pytest
import torch
from eye_material import drawn_eye, encoder, graph, net

from encoder.backends import BackendName
from encoder.denoiser.config import PRESETS as DENOISERS
from encoder.denoiser.model import Denoiser
from encoder.driver import Driver
from encoder.eyes.gaze_statistics import step_deg
from encoder.inference import choose_condition, eyes_fit, load_driver
from encoder.nn.checkpoint import save
from encoder.types import DriverState
from sensors.types import InputError, SensorFrame

EYES, GRAPH = encoder(), graph()


def models() -> tuple[driver_material.AudioEncoder, Denoiser]:
    audio, gaze = driver_material.models()
    config = replace(DENOISERS["debug"], condition="eyes", condition_dim=160)
    torch.manual_seed(1)
    denoiser = Denoiser(config)
    tensors = {k: v for k, v in gaze.state_dict().items() if "input." not in k and "null" not in k}
    denoiser.load_state_dict(tensors, strict=False)
    return audio, denoiser.eval()


def driver(backend: BackendName = "onnx") -> Driver:
    audio, denoiser = models()
    return driver_material.driver_of(audio, denoiser, backend, eyes=EYES, graph=GRAPH)


def pictures(frames: int) -> np.ndarray:  # [T, 2, 400, 400]
    kinds = [drawn_eye(x, 0.05, lid) for x in (-0.1, 0.1) for lid in (0.4, 1.0)]
    return np.array([[kinds[t // 5 % 4], kinds[t // 5 % 4]] for t in range(frames)])


def drive(
    d: Driver, eyes: np.ndarray, valid: np.ndarray, state: DriverState | None = None,
    sound: np.ndarray | None = None, first: int = 0,
) -> tuple[np.ndarray, np.ndarray, DriverState]:  # fmt: skip
    state = state or d.init_state(5)
    sound = driver_material.sound(len(eyes)) if sound is None else sound
    codes, gaze = [], []
    for i, audio in enumerate(sound):
        frame = driver_material.sensor_frame(first + i, audio)
        frame = replace(frame, eyes=eyes[i], eyes_valid=valid[i])
        driven, state = d.step(frame, state)
        assert np.isfinite(driven.expression).all() and np.isfinite(driven.gaze).all()
        codes.append(driven.expression)
        gaze.append(driven.gaze)
    return np.array(codes), np.array(gaze), state


@pytest.mark.slow
@pytest.mark.parametrize("backend", ["torch", "onnx", "onnx-int8"])
def test_eyes_are_seen_and_the_future_is_not(backend: BackendName) -> None:
    d, eyes, valid = driver(backend), pictures(20), np.ones((20, 2), bool)
    codes, gaze, _ = drive(d, eyes, valid)
    noise = np.random.default_rng(0).integers(0, 256, (400, 400), dtype=np.uint8)
    for junk in (drawn_eye(0.2, -0.1, 0.8), noise):
        changed = eyes.copy()
        changed[12:] = junk
        other, other_gaze, _ = drive(d, changed, valid)
        assert np.array_equal(other[:12], codes[:12])
        assert np.array_equal(other_gaze[:12], gaze[:12])
        assert np.abs(other[12] - codes[12]).max() > 1e-4  # the newest frame does see it
    assert np.array_equal(drive(d, eyes, valid)[0], codes)


def test_state_is_a_value() -> None:
    d, eyes, valid = driver(), pictures(40), np.ones((40, 2), bool)
    valid[10:30, 0], valid[15:25, 1] = False, False
    sound = driver_material.sound(40)
    whole, _, _ = drive(d, eyes, valid, sound=sound)
    _, _, state = drive(d, eyes[:17], valid[:17], sound=sound[:17])
    rest, _, _ = drive(d, eyes[17:], valid[17:], state, sound[17:], first=17)
    assert np.array_equal(rest, whole[17:])


def test_dead_cameras_and_a_dead_microphone_leave_it_alive() -> None:
    d, eyes = driver(), pictures(120)
    valid = np.ones((120, 2), bool)
    valid[20:50, 1] = False
    valid[60:] = False
    _, gaze, _ = drive(d, eyes, valid, sound=np.zeros((120, 1600), np.float32))
    assert step_deg(gaze[70:]).max() > 0.1  # the eyes wander on
    largest = max(step_deg(gaze[:20]).max(), step_deg(GRAPH.gaze[:40].reshape(-1, 2, 3)).max())
    assert step_deg(gaze).max() <= largest


def test_no_pictures_at_all() -> None:
    d = driver()
    state = d.init_state(1)
    for i, audio in enumerate(driver_material.sound(30)):
        driven, state = d.step(driver_material.sensor_frame(i, audio), state)
        assert np.isfinite(driven.expression).all()


def test_recentring_moves_the_gaze() -> None:
    d, eyes, valid = driver(), pictures(3), np.ones((3, 2), bool)
    _, gaze, state = drive(d, eyes, valid)
    _, after, _ = drive(d, eyes, valid, d.recentred(state))
    assert np.abs(gaze[-1].mean(0)[:2]).max() > 1e-3
    assert np.abs(after[-1].mean(0)[:2]).max() < 1e-3


def test_a_frame_that_asks_for_it_recentres_or_starts_anew() -> None:
    d, eyes, valid = driver(), pictures(3), np.ones((3, 2), bool)
    _, _, state = drive(d, eyes, valid)
    frame = driver_material.sensor_frame(3, driver_material.sound(1)[0])
    frame = replace(frame, eyes=eyes[0], eyes_valid=valid[0])
    for wanted, same in (("recentre", d.recentred(state)), ("reset", d.init_state(state.seed))):
        asked, _ = d.step(replace(frame, requests=(wanted,)), state)
        plain, _ = d.step(frame, same)
        unasked, _ = d.step(frame, state)
        assert np.array_equal(asked.gaze, plain.gaze)
        assert not np.array_equal(asked.gaze, unasked.gaze)
        assert np.array_equal(asked.expression, plain.expression)


def test_timer_sees_the_eyes() -> None:
    d, timer = driver(), driver_material.StageNames()
    frame = driver_material.sensor_frame(0, driver_material.sound(1)[0])
    frame: SensorFrame = replace(frame, eyes=pictures(1)[0], eyes_valid=np.ones(2, bool))
    d.step(frame, d.init_state(0), timer)
    assert timer.names == ["eyes", "audio", "gaze", "denoise"]


@pytest.mark.parametrize("backend", ["torch", "onnx-int8"])
def test_looking_while_listening_changes_nothing(
    backend: BackendName, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One after the other, and at once: the same to the bit, whatever the cameras deliver."""
    d, eyes, valid, found = driver(backend), pictures(30), np.ones((30, 2), bool), []
    valid[8:12, 0], valid[15:24] = False, False
    for cpus in (1, 2):
        monkeypatch.setattr(d._threads, "count", cpus)
        found.append(drive(d, eyes, valid)[:2])
    d.close()
    assert np.array_equal(found[0][0], found[1][0]) and np.array_equal(found[0][1], found[1][1])


def test_an_error_of_the_eyes_ends_the_step(monkeypatch: pytest.MonkeyPatch) -> None:
    d = driver()
    monkeypatch.setattr(d._threads, "count", 2)
    monkeypatch.setattr(d.eyes, "read", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        drive(d, pictures(1), np.ones((1, 2), bool))
    d.close()


def test_loads_by_condition(tmp_path: Path) -> None:
    driver_material.write_weights(tmp_path)
    with pytest.raises(InputError, match="student_eyes"):
        load_driver(tmp_path, device="cpu", condition="eyes")
    _, denoiser = models()
    card = {"kind": "student", "config": asdict(denoiser.config)}
    save(tmp_path / "student_eyes", denoiser.state_dict(), card)
    with pytest.raises(InputError, match="eyes"):
        load_driver(tmp_path, device="cpu", condition="eyes")
    made = net()
    save(tmp_path / "eyes", made.state_dict(), {"kind": "eyes", "config": asdict(made.config)})
    assert load_driver(tmp_path, device="cpu", condition="eyes").config.condition == "eyes"
    assert load_driver(tmp_path, device="cpu").config.condition == "gaze"
    save(tmp_path / "student", denoiser.state_dict(), card)
    with pytest.raises(InputError, match="--condition eyes"):
        load_driver(tmp_path, device="cpu")  # an eyes model under the gaze model's name


def test_a_student_that_sees_has_the_emotions_of_the_one_it_was_made_from(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    driver_material.write_weights(tmp_path)
    _, denoiser = models()
    card = {"kind": "student", "config": asdict(denoiser.config), "audio_model": {"sha256": "s"}}
    save(tmp_path / "student_eyes", denoiser.state_dict(), card)
    made = net()
    save(tmp_path / "eyes", made.state_dict(), {"kind": "eyes", "config": asdict(made.config)})
    asked: list[str] = []
    monkeypatch.setattr(
        "encoder.emotion.control.load_emotions", lambda _, sha256: asked.append(sha256)
    )
    load_driver(tmp_path, device="cpu", condition="eyes")
    load_driver(tmp_path, device="cpu")
    assert asked[0] == "s" and asked[1] != "s"


def test_auto_takes_the_eyes_only_where_there_are_some() -> None:
    assert choose_condition("auto", has_eyes=False) == "gaze"
    assert choose_condition("gaze", has_eyes=True) == "gaze"
    assert choose_condition("eyes", has_eyes=False) == "eyes"


def test_auto_sees_only_with_weights_that_belong_together(tmp_path: Path) -> None:
    def card(name: str, **words: object) -> None:
        (tmp_path / f"{name}.json").write_text(json.dumps(words))

    assert not eyes_fit(tmp_path)
    card("eyes", sha256="e")
    card("student", sha256="s")
    card("student_eyes", sha256="v", eyes_sha256="e", audio_model={"sha256": "s"})
    assert eyes_fit(tmp_path)
    card("student", sha256="trained anew")
    assert not eyes_fit(tmp_path)
    for damaged in ("{", "{}", "[]"):  # red before: a traceback
        (tmp_path / "student.json").write_text(damaged)
        with pytest.raises(InputError, match="restore"):
            eyes_fit(tmp_path)
