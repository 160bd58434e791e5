"""Emotions: an untrained one changes nothing, 0 is neutral to the bit, fades never jump."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
import torch
from driver_material import BACKENDS, driver, models, sound

from encoder.backends import BackendName
from encoder.denoiser.config import ZeroConvConfig
from encoder.denoiser.zero_conv import ZeroConvs
from encoder.driver import Driver
from encoder.emotion.control import FADE_FRAMES, Emotions, load_emotions
from encoder.nn.checkpoint import save
from encoder.types import Mood
from sensors.types import FPS, InputError, SensorFrame

LABELS = ("happy", "sad", "angry")


def emotions(width: int = 2 * (3 * 64 + 256)) -> Emotions:
    table = np.random.default_rng(3).standard_normal((len(LABELS), width))
    return Emotions(LABELS, (0.5 * table).astype(np.float32))


def feeling(backend: BackendName = "onnx") -> Driver:
    made = driver(backend)
    made.emotions = emotions()
    return made


def drive(made: Driver, audio: np.ndarray, words: list[str] | str) -> np.ndarray:
    state, codes, blind = made.init_state(5), [], np.zeros(2, bool)
    words = [words] * len(audio) if isinstance(words, str) else words
    for i, chunk in enumerate(audio):
        t_ns = (i + 1) * 10**9 // FPS
        frame = SensorFrame(i, t_ns, chunk, None, blind, np.zeros(2, np.int64), False, words[i])
        driven, state = made.step(frame, state)
        codes.append(driven.expression)
    return np.array(codes)


def test_untrained_zero_convolutions_change_no_bit() -> None:
    _, denoiser = models()
    zero = ZeroConvs(ZeroConvConfig(labels=LABELS, places=denoiser.config.places))
    assert zero.embeddings.shape == (3, 512) and len(zero.shifts) == denoiser.config.layers + 2
    noisy, audio, gaze = torch.randn(2, 40, 256), torch.randn(2, 40, 512), torch.randn(2, 40, 6)
    tau, added = torch.full((2,), 200), zero(torch.rand(2, 3))
    with torch.no_grad():
        expected = denoiser(noisy, tau, audio, gaze)
        assert torch.equal(denoiser(noisy, tau, audio, gaze, emotion=added), expected)
        start = denoiser.init_state(2)
        frames, _ = denoiser.step(noisy, tau, audio, gaze, start)
        same, _ = denoiser.step(noisy, tau, audio, gaze, start, emotion=added)
        assert torch.equal(frames, same)
        for convs in (zero.shifts, zero.scales):
            for conv in convs:
                torch.nn.init.normal_(conv.bias)  # type: ignore[arg-type]
            other = denoiser(noisy, tau, audio, gaze, emotion=zero(torch.rand(2, 3)))
            assert (other - expected).abs().max() > 0.1
            expected = other


def test_every_place_counts_and_only_its_own() -> None:
    """Each row of the table reaches the code; `forward` and `step` add it at the same place."""
    _, denoiser = models()
    shapes = (256, 512, 6)
    noisy, audio, gaze = (torch.randn(1, 5, n) for n in shapes)
    tau, seen = torch.tensor([200]), []
    with torch.no_grad():
        width = 2 * sum(denoiser.config.places)
        for start in range(0, width, 64):  # shift and scale of a place in turn
            added = torch.zeros(1, width)
            added[:, start : start + 64] = torch.randn(64)
            whole = denoiser(noisy, tau, audio, gaze, emotion=added)
            state = denoiser.init_state(1)
            steps, _ = denoiser.step(noisy, tau, audio, gaze, state, emotion=added)
            assert (whole - steps).abs().max() < 1e-5
            seen.append(whole)
    assert all((a - b).abs().max() > 1e-3 for a, b in zip(seen, seen[1:], strict=False))


@pytest.mark.parametrize("backend", BACKENDS)
def test_intensity_0_is_neutral_to_the_bit_and_more_is_more(backend: BackendName) -> None:
    audio, made = sound(30), feeling(backend)
    neutral = drive(driver(backend), audio, "")
    for words in ("", "neutral", "happy:0", "happy:0+sad:0"):
        assert np.array_equal(drive(made, audio, words), neutral)
    far = [np.abs(drive(made, audio, f"happy:{i / 4}") - neutral)[12:].mean() for i in range(5)]
    assert far[0] == 0 and all(a < b for a, b in zip(far, far[1:], strict=False))


def test_onnx_adds_what_torch_adds() -> None:
    audio = sound(60)
    words = ["happy:0.7"] * 30 + ["sad:0.5+angry:0.5"] * 30
    expected, actual = (drive(feeling(name), audio, words) for name in ("torch", "onnx"))
    assert np.abs(actual - expected).max() < 2e-5 * np.abs(expected).max()
    quantised = drive(feeling("onnx-int8"), audio, words)
    error = np.linalg.norm(quantised - expected, axis=1) / np.linalg.norm(expected, axis=1)
    assert 0 < error.mean() < 0.05


def test_a_change_later_alters_nothing_before_it_and_repeats() -> None:
    audio, made = sound(40), feeling()
    changed = drive(made, audio, [""] * 20 + ["angry"] * 20)
    steady = drive(made, audio, "")
    assert np.array_equal(changed[:20], steady[:20])
    assert not np.array_equal(changed[20], steady[20])
    assert np.array_equal(drive(made, audio, [""] * 20 + ["angry"] * 20), changed)


def test_a_fade_takes_300_ms_in_even_steps_even_when_it_is_broken_off() -> None:
    felt, mood, shares = emotions(), Mood(), []
    words = ["happy"] * FADE_FRAMES + ["sad"] * 4 + ["neutral"] * FADE_FRAMES
    assert FADE_FRAMES == 9
    for word in words:
        added, mood = felt.step(word, mood)
        added = np.zeros_like(felt.table[0]) if added is None else added
        shares.append(np.linalg.lstsq(felt.table.reshape(3, -1).T, added.ravel(), rcond=None)[0])
    path = np.array([np.zeros(3), *shares])
    assert np.allclose(path[FADE_FRAMES], [1, 0, 0], atol=1e-5)
    assert np.allclose(path[FADE_FRAMES + 4], [5 / 9, 4 / 9, 0], atol=1e-5)
    assert added is not None and np.array_equal(added, np.zeros_like(added))
    assert np.abs(np.diff(path, axis=0)).max() < 1 / FADE_FRAMES + 1e-5


def test_words() -> None:
    felt = emotions()
    for words, expected in (
        ("happy", [1, 0, 0]),
        ("sad:0.25", [0, 0.25, 0]),
        ("happy+angry", [0.5, 0, 0.5]),
        (" happy:0.5 + angry:0.25 ", [0.5, 0, 0.25]),
        ("neutral+sad:0.5", [0, 0.5, 0]),
    ):
        assert np.allclose(felt.mixture(words), expected), words
    for words, hint in (
        ("hapy", "did you mean happy"),
        ("happy:2", "0..1"),
        ("happy:nan", "0..1"),
        ("happy:much", "0..1"),
        ("happy:0.7+sad:0.7", "at most 1"),
        ("happy+sad+angry", "at most 2"),
    ):
        with pytest.raises(InputError, match=hint):
            felt.mixture(words)


def test_an_emotion_is_named_once() -> None:
    """Red before: `happy+happy` was as happy as `happy`. A session that holds it is replayed."""
    felt = emotions()
    for words in ("happy+happy", "sad:0.2 + sad"):
        with pytest.raises(InputError, match="each emotion once"):
            felt.check(words)
    for words in ("", "neutral", "happy+sad"):
        felt.check(words)
    assert felt.step("happy+happy", Mood())[0] is not None


def test_weights_of_another_student_are_left_alone(tmp_path: Path) -> None:
    zero = ZeroConvs(ZeroConvConfig(labels=LABELS, places=(8, 8, 256)))
    torch.nn.init.normal_(zero.scales[0].bias)  # type: ignore[arg-type]
    card = {"kind": "emotion", "config": asdict(zero.config), "student_sha256": "mine"}
    assert load_emotions(tmp_path, "mine") is None
    save(tmp_path / "emotion", zero.state_dict(), card)
    assert load_emotions(tmp_path, "other") is None
    loaded = load_emotions(tmp_path, "mine")
    assert loaded is not None and loaded.labels == LABELS
    assert np.allclose(loaded.table, zero.table().detach().numpy())
    wide = replace(zero.config, places=(9, 8, 256))
    save(tmp_path / "emotion", zero.state_dict(), card | {"config": asdict(wide)})
    with pytest.raises(InputError, match="livedrive train emotion"):
        load_emotions(tmp_path, "mine")


def test_a_driver_without_emotions_says_so() -> None:
    made = driver()
    made.check_emotion("neutral")
    with pytest.raises(InputError, match="livedrive train emotion"):
        made.check_emotion("happy")
