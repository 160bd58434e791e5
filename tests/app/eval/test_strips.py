"""Strips of mouths: which frames they show, and how they are laid out."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.commands.eval import EvalSpeech
from app.eval.speech import strips
from app.eval.speech.following import Followed, tracked_folder
from app.eval.speech.settings import SpeechSettings
from encoder import inference
from encoder.capture.speech.phones import Phone
from sensors.types import InputError

FRAMES = 60
CODES = np.arange(FRAMES, dtype=np.float32)[:, None].repeat(256, 1)


def clip(*phones: Phone) -> Followed:
    return Followed(CODES, 100 + CODES, phones)


def test_the_phone_of_median_length_of_the_best_kind_is_shown_at_its_middle():
    first = clip(Phone("b", 0, 0.4), Phone("m", 0.4, 0.5), Phone("s", 0.5, 0.6))
    second = clip(
        Phone("s", 0, 0.9),
        Phone("s", 1.0, 1.2),
        Phone("m", 1.9, 2.9),  # beyond the clip's end
    )
    found = dict(zip(strips.KINDS, strips.shots([first, second]), strict=True))
    assert found["th"] is None and found["u"] is None
    m, s = found["m"], found["s"]
    assert m is not None and s is not None
    assert m.phone == "m" and m.shown[0] == round(0.45 * 30) - 1
    assert s.phone == "s" and s.shown[0] == 32 and s.tracked[0] == 132


def test_a_strip_shows_above_what_is_tracked():
    def draw(code: np.ndarray) -> np.ndarray:
        return np.full((strips.HEIGHT_PX, strips.WIDTH_PX, 3), code[0], np.uint8)

    shot = strips.MouthShot("s", np.full(256, 40), np.full(256, 120))
    page = strips.strip("somebody", [None, shot], draw)
    assert page.shape == (2 * (strips.HEIGHT_PX + strips.LABEL_PX), 2 * strips.WIDTH_PX, 3)
    middle = page[:, strips.WIDTH_PX + 20, 0]
    below = strips.LABEL_PX + strips.HEIGHT_PX
    assert (middle[strips.LABEL_PX : below] == 40).all()
    assert (middle[below : below + strips.HEIGHT_PX] == 120).all()
    label = page[-strips.LABEL_PX :]
    assert label[:, strips.WIDTH_PX :].min() < 100 and label[:, : strips.WIDTH_PX].min() == 255


def test_a_folder_of_tracked_faces_is_asked_for():
    with pytest.raises(InputError, match="--mocap FOLDER"):
        tracked_folder(None)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"strips": Path("s")}, "--strips: expected --leave-one-out beside it, got none"),
        ({"mocap": Path("m")}, "--mocap: expected --leave-one-out beside it"),
        ({"films": Path("f")}, "--films: expected --peers beside it"),
    ],
)
def test_what_does_nothing_alone_is_refused(
    given: dict[str, Any], told: str, tmp_path: Path
) -> None:
    """Red before: tables were made, and neither pictures nor films."""
    with pytest.raises(InputError, match=told):
        EvalSpeech(data=tmp_path, settings=SpeechSettings(**given)).run()


def test_where_nothing_can_be_drawn_no_folder_is_made(tmp_path: Path) -> None:
    """Red before: there was an empty one."""
    given = SpeechSettings(leave_one_out=True, mocap=tmp_path, strips=tmp_path / "strips")
    with pytest.raises(InputError, match="--leave-one-out: expected students in"):
        EvalSpeech(data=tmp_path, settings=given).run()
    assert not (tmp_path / "strips").exists()


@pytest.mark.parametrize(
    ("given", "told"), [({}, "livedrive capture"), ({"peers": Path("none")}, "--peers none: ")]
)
def test_data_are_looked_for_before_networks_are_loaded(
    given: dict[str, Any], told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Red before: ten seconds later."""
    monkeypatch.setattr(inference, "load_networks", lambda weights: pytest.fail("loaded"))
    with pytest.raises(InputError, match=told):
        EvalSpeech(data=tmp_path, settings=SpeechSettings(**given)).run()
