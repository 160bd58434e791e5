"""What the audio encoder learns from: lessons, spectra by other ears, and what its losses ask."""

import numpy as np
import pytest
import torch

from encoder.audio.config import PRESETS
from encoder.audio.spectrum import Spectrum
from encoder.capture.dataset import Clip
from encoder.capture.speech.phones import PHONE_INDEX, PHONES
from encoder.training.stages import audio
from encoder.training.streams import ears, heard
from encoder.training.viseme_teacher import VISEME_OF_PHONE, VISEMES

SPECTRUM = PRESETS["phonetic-debug"].spectrum
assert SPECTRUM is not None


def clip(**more: object) -> Clip:
    """A second and a third of a 200 Hz voice that says aa, then s, then nothing."""
    time = np.arange(32_000) / 24_000
    sound = np.where(time < 1, np.sign(np.sin(2 * np.pi * 200 * time)) * 8000, 0)
    spans = [(PHONE_INDEX["aa"], 0.0, 0.5), (PHONE_INDEX["s"], 0.5, 1.0)]
    settings = {"truth": "rules", "voice": "real-me", "spans": np.array(spans, np.float32)} | more
    none = np.zeros((40, 3))
    return Clip(
        audio=sound.astype(np.int16), rig=none, gaze=none, phones=np.zeros(40), tongue=none,
        **settings,  # type: ignore[arg-type]
    )  # fmt: skip


def test_a_lesson_knows_phones_visemes_and_pitch():
    lesson = heard.prepare(clip(), None)
    assert len(lesson.phones) == 160
    late = round(heard.LABEL_LATE_S * 120)
    assert lesson.phones[30] == PHONE_INDEX["aa"] and lesson.phones[60 + late] == PHONE_INDEX["s"]
    assert lesson.phones[-1] == 0
    ahead = heard.cut(lesson, 100, np.random.default_rng(2))
    same = (ahead.ahead[: -heard.AHEAD] == ahead.visemes[heard.AHEAD :]).all(1)
    assert same.mean() > 0.95  # played faster or slower, the two may differ by a feature
    assert VISEMES[int(lesson.visemes[30].argmax())] == "aa"
    voiced, octaves = lesson.pitch[10:100].astype(float).mean(0)
    assert voiced > 0.9 and 2**octaves * heard.PITCH_HZ == pytest.approx(200, rel=0.03)
    assert lesson.pitch[-20:, 0].max() < 0.1
    unknown = heard.prepare(clip(spans=np.zeros((0, 3), np.float32)), None)
    assert (unknown.phones == -1).all()


def test_every_phone_has_a_viseme():
    assert len(VISEME_OF_PHONE) == len(PHONES)
    assert {VISEMES[v] for v in VISEME_OF_PHONE} == set(VISEMES)


def test_crops_keep_sound_and_labels_together():
    lesson, rng = heard.prepare(clip(), None), np.random.default_rng(0)
    for _ in range(20):
        cut = heard.cut(lesson, 120, rng)
        level = np.sqrt((cut.clean.reshape(120, 200) ** 2).mean(1))
        speaks = cut.phones > 0
        assert level[speaks][3:-3].min(initial=1) > 0.1
        if (~speaks).sum() > 20:
            assert np.mean(level[~speaks] < 0.05) > 0.7
    noisy = heard.amid_noise([heard.cut(lesson, 120, rng) for _ in range(40)], rng)
    assert all(np.abs(x.noisy).max() <= 1 and np.isfinite(x.noisy).all() for x in noisy)
    silent = [x for x in noisy if not x.clean.any()]
    assert 0 < len(silent) < 15 and all((x.phones == 0).all() for x in silent)


def test_other_ears_hear_other_spectra_and_gain_none():
    spectrum, rng = Spectrum(SPECTRUM), np.random.default_rng(0)
    sound = torch.randn(1, 600 + 200 * 59) * 0.05
    power = spectrum.power(sound).repeat(8, 1, 1)
    different = ears.augmented(power, spectrum, ears.banks(spectrum), rng)
    assert different.shape == (8, 60, SPECTRUM.bands) and different.isfinite().all()
    assert (different[0] - different[1]).abs().mean() > 0.05
    plain = spectrum.bank
    near, far = (
        spectrum.scaled(bands, ears.peaks(spectrum, bands))
        for bands in (power[:1] @ plain, 1e-2 * power[:1] @ plain)
    )
    assert (near - far)[:, 20:].abs().mean() < 0.15 < near.std()  # 20 dB down looks the same


def test_the_losses_are_least_where_everything_is_said():
    lesson = heard.cut(heard.prepare(clip(), None), 120, np.random.default_rng(1))
    right = torch.zeros(1, 120, audio.WIDTH)
    right[0, torch.arange(120), torch.from_numpy(lesson.phones)] = 6
    visemes = np.concatenate([lesson.visemes, lesson.ahead], 1)
    right[0, :, len(PHONES) : -3] = torch.from_numpy(visemes) * 12 - 6
    right[0, :, -3:-1] = torch.from_numpy(lesson.pitch)
    right[..., -3] = right[..., -3] * 12 - 6
    loudness = torch.zeros(1, 120)
    best = audio.losses(right, [lesson], loudness)
    for part in (slice(0, len(PHONES)), slice(len(PHONES), -3), slice(-3, None)):
        wrong = right.clone()
        wrong[..., part] = wrong[..., part].roll(1, -1) + 0.3
        assert audio.losses(wrong, [lesson], loudness)["total"] > best["total"] + 0.05
