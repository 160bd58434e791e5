"""What the user says wins over a preset, in every stage."""

from pathlib import Path

import pytest

from encoder.training.loop import RunSettings
from encoder.training.stages import audio, contact, diffusion, distill, emotion, eyes, multimodal
from sensors.types import InputError

PATHS = {
    audio: ("pack", "output"),
    contact: ("streams", "student", "output"),
    diffusion: ("streams", "output"),
    distill: ("streams", "teacher", "output"),
    emotion: ("streams", "student", "output"),
    eyes: ("pictures", "output"),
    multimodal: ("streams", "student", "eyes", "output"),
}


@pytest.mark.parametrize("stage", PATHS, ids=lambda stage: stage.__name__.split(".")[-1])
def test_settings_win_over_the_preset(stage) -> None:
    needed = {name: Path(name) for name in PATHS[stage]} | {"run": RunSettings(state=Path("state"))}
    default = stage.preset("default", **needed)
    for name in ("debug", "paper"):
        plain = stage.preset(name, **needed)
        assert plain.steps != default.steps
        asked = stage.preset(name, steps=10, rate=0.5, **needed)
        assert (asked.steps, asked.rate) == (10, 0.5)


def test_an_unknown_preset_is_named_with_the_known_ones() -> None:
    with pytest.raises(InputError, match="debug, default, paper, got 'papre'"):
        diffusion.preset("papre")


def test_fine_tuning_takes_the_loss_of_the_lips_that_it_is_given() -> None:
    needed = {name: Path(name) for name in PATHS[emotion]} | {
        "run": RunSettings(state=Path("state"))
    }
    assert emotion.preset("default", fine_tune=True, **needed).lip_weight > 0
    assert emotion.preset("default", fine_tune=True, lip_weight=0.0, **needed).lip_weight == 0
