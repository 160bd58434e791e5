"""What hears voices: it learns what is none, and takes voices for voices as before."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from training_material import FACE, chain_that_hears_no_phones, pack_of_tones

from encoder.audio.config import PRESETS as AUDIO
from encoder.audio.encoder import AudioEncoder
from encoder.denoiser.direct import Direct
from encoder.inference import load_networks, load_student
from encoder.nn import checkpoint
from encoder.training import loop
from encoder.training.stages import listen, voice_activity
from sensors.types import InputError

pytestmark = pytest.mark.slow


def settings(folder: Path, **more) -> voice_activity.VoiceActivityConfig:
    names = ("pack", "audio", "chain", "output")
    given = dict.fromkeys(names, folder) | {"run": loop.RunSettings(state=folder / "activity")}
    return voice_activity.preset("debug", **{**given, **more})


def test_sounds_are_no_voices_and_voices_stay_voices(tmp_path) -> None:
    torch.manual_seed(0)
    direct = Direct(7, 256, 5)
    for layer in (direct.hear, direct.voice):
        torch.nn.init.normal_(layer.weight)
    torch.nn.init.zeros_(direct.hear.weight[:, 3])  # so all sound alike before
    people, sounds = np.random.default_rng(0).standard_normal((2, 2000, 7)).astype(np.float32) * 2
    sounds[:, 3] += 10
    before = [voice_activity.voiced(direct, heard) for heard in (people, sounds)]
    config = settings(tmp_path, steps=400, batch=200, rate=1e-2, drop=0.0)
    metrics, _ = voice_activity.train(direct, people, sounds, config)
    after = [voice_activity.voiced(direct, heard) for heard in (people, sounds)]
    assert (before[1] > 0.5).mean() > 0.3 > 0.05 > (after[1] > 0.5).mean()
    assert np.abs(after[0] - before[0]).mean() < 0.1 and metrics["voices_lost"] < 0.15


@pytest.fixture
def config(tmp_path: Path) -> voice_activity.VoiceActivityConfig:
    """Of a chain that hears phones."""
    paths = chain_that_hears_no_phones(tmp_path)
    run = loop.RunSettings(state=tmp_path / "state")
    listen.run(listen.preset("debug", **paths, run=run), FACE)
    folder = paths["output"]
    return settings(tmp_path, pack=paths["pack"], audio=folder / "audio", chain=folder)


def test_nothing_but_what_hears_voices_is_changed(config, tmp_path) -> None:
    sizes, before, card = load_student(config.chain, "gaze")
    rate = replace(config, rate=1.0, output=tmp_path / "new")
    voice_activity.run(rate)
    after = load_student(rate.output, "gaze")
    assert after[0] == sizes and after[2]["listen"] == card["listen"]
    assert after[2]["voice_activity"]["metrics"]["sounds_as_voices"] >= 0
    changed = {
        name for name, tensor in after[1].items() if not np.array_equal(tensor, before[name])
    }
    assert changed == {
        f"direct.{name}" for name in ("hear.weight", "hear.bias", "voice.weight", "voice.bias")
    }
    for condition in ("gaze", "eyes"):
        assert load_networks(rate.output, condition)[0].config.condition == condition
    now = checkpoint.load(rate.output / "student", "student")[1]["sha256"]
    assert checkpoint.load(rate.output / "emotion", "emotion")[1]["student_sha256"] == now


def test_the_student_can_stay_where_it_is(config) -> None:
    voice_activity.run(replace(config, output=config.chain))
    assert load_networks(config.chain, "eyes")[0].config.condition == "eyes"


def test_who_is_left_out_is_not_heard(config, tmp_path, monkeypatch) -> None:
    heard = []
    monkeypatch.setattr(voice_activity, "stacked", lambda _, sound: heard.append(sound))
    with pytest.raises(InputError, match="expected clips of people"):
        voice_activity.run(replace(config, without=("tone",), output=tmp_path / "left"))
    assert not heard


def test_who_is_left_out_must_be_there(config, tmp_path) -> None:
    """Red before: a misspelt name was heard, and trained on, without a word."""
    with pytest.raises(InputError, match="--leave-out: expected one of tone, got 'tome'"):
        voice_activity.run(replace(config, without=("tome",), output=tmp_path / "left"))


def test_a_chain_that_hears_no_phones_is_refused(tmp_path) -> None:
    paths = chain_that_hears_no_phones(tmp_path)
    with pytest.raises(InputError, match="train listen` first"):
        voice_activity.run(settings(tmp_path, audio=paths["old"] / "audio", chain=paths["old"]))


def test_crops_are_heard_once_for_each_recipe(tmp_path) -> None:
    config = settings(tmp_path, pack=pack_of_tones(tmp_path), people=3, sounds=2)
    phones = AudioEncoder(replace(AUDIO["phonetic-debug"], past_ticks=2))

    def hear(recipe: str, crops: Iterable[np.ndarray]) -> np.ndarray:
        return voice_activity.hear(tmp_path / "heard.npz", recipe, crops, 3, phones, resumed=False)

    first = hear("one", voice_activity.people_of(config))
    assert len(first) == 3 * 40 and first.dtype == np.float16
    np.testing.assert_array_equal(first, hear("one", []))  # as it was kept
    assert len(hear("other", voice_activity.sounds_of(config))) == 2 * voice_activity.FRAMES
    np.testing.assert_array_equal(first, hear("one", voice_activity.people_of(config)))
