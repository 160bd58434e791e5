"""`livedrive eval rest`: sounds that are no voice, made or recorded."""

import json
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import soundfile

from app.eval.speech import live, rest
from app.eval.speech.rest import RestSettings
from sensors.types import InputError


def test_every_kind_of_sound_is_made_anew(monkeypatch):
    monkeypatch.setattr(rest, "SECONDS", 1)
    made = list(rest.made(rest.kinds(), 0))
    names = [name for name, _ in made]
    assert set(names) >= {"rub", "friction", "wind", "taps", "buzz", "played"}
    assert all(names.count(name) == rest.DRAWS for name in names)
    assert all(x.shape == (48_000,) and x.dtype == np.float32 and x.any() for _, x in made)
    assert not np.array_equal(made[0][1], made[1][1])


@pytest.mark.slow
def test_recordings_of_one_s_own_are_judged(tmp_path, capsys):
    """A hum leaves lips at rest; a missed threshold is an exit with status 1."""
    soundfile.write(tmp_path / "hum.wav", 0.1 * np.sin(np.arange(48_000) * 0.0065), 48_000)
    report = tmp_path / "r.json"
    rest.evaluate(RestSettings(sounds=tmp_path, report=report))
    metrics = json.loads(report.read_text())["metrics"]
    assert metrics["hum/open_share"] == 0 and 0 < metrics["hum/widest_mm"] < 2
    assert "hum/open_share" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("name", "sound", "told"),
    [
        ("text.wav", None, "expected a sound file, got something else"),  # red before: a traceback
        ("short.wav", np.zeros(100), "expected a sound of 1 s or more, got 0.00 s"),  # another
        ("nan.wav", np.full(48_000, np.nan), "got NaN in it"),  # lips at rest: ok
    ],
)
def test_a_recording_that_tells_nothing_is_told(tmp_path, name, sound, told):
    (tmp_path / name).write_text("no sound")
    if sound is not None:
        soundfile.write(tmp_path / name, sound, 48_000, subtype="FLOAT")
    with pytest.raises(InputError, match=f"{name}: .*{told}"):
        list(rest.sounds(RestSettings(sounds=tmp_path)))


def test_a_folder_without_recordings_is_told(tmp_path):
    with pytest.raises(InputError, match=r"expected \.ogg.*give a folder of recordings"):
        list(rest.sounds(RestSettings(sounds=tmp_path)))


def test_recordings_too_short_to_be_judged_are_left_out(tmp_path, monkeypatch):
    """Red before: one of 0.9 s among hundreds ended `eval speech --speech` after its tables."""
    for name, seconds in (("a", 0.9), ("b", 3.0)):
        sound = 0.1 * np.random.default_rng(0).standard_normal(int(seconds * 48_000))
        soundfile.write(tmp_path / f"{name}.wav", sound, 48_000)
    monkeypatch.setattr(live, "drive", lambda driver, sound, seed: np.arange(len(sound) // 1600))
    mesh: Any = SimpleNamespace(opening_mm=np.sin)
    assert live.speech_metrics(cast(Any, None), mesh, tmp_path, 1, 0)["recordings"] == 1
