"""The avatar's mouth in millimetres; table, thresholds and plot of classes of phones."""

from collections.abc import Callable

import numpy as np
import pytest
from web_client import AVATAR

from app.eval.speech import articulation
from app.eval.speech.following import Followed
from app.face.mouth import mouth_of
from encoder.capture.motion.gestures import TOUCH_POSE
from encoder.capture.speech.phones import Phone
from encoder.evaluation.articulation import MEASURES, figures
from render.decoder.decoder import Decoder

CLENCHED = {"jawOpen": 0.04, "mouthLowerDown": 0.8, "mouthUpperUp": 0.5}


@pytest.fixture(scope="module")
def decoder() -> Decoder:
    return Decoder.load()


@pytest.fixture(scope="module")
def measured(decoder: Decoder) -> Callable[..., dict[str, float]]:
    mouth = mouth_of(AVATAR)

    def of(**shapes: float) -> dict[str, float]:
        row = mouth(code_of(decoder, shapes)[None])
        return {name: float(getattr(row, name)[0]) for name in MEASURES}

    return of


def code_of(decoder: Decoder, shapes: dict[str, float]) -> np.ndarray:
    """A name without its side is of both sides."""
    rig = np.zeros(53, np.float32)
    for name, value in shapes.items():
        for index, full in enumerate(decoder.rig_names):
            if full == name or full.rsplit("_", 1)[0] == name:
                rig[index] = value
    return decoder.encode(rig)


def test_a_resting_mouth_is_shut_and_shows_no_teeth(measured):
    rest = measured()
    assert rest["opening"] < 0.5 and rest["teeth"] < 0.1
    assert rest["width"] == pytest.approx(0, abs=0.01)
    assert rest["protrusion"] == pytest.approx(0, abs=0.01)


def test_a_dropped_jaw_shows_a_dark_gap_and_parted_lips_show_teeth(measured):
    jaw, lips = measured(jawOpen=0.3), measured(**CLENCHED)
    assert jaw["opening"] == pytest.approx(lips["opening"], abs=1.5)
    assert lips["teeth"] > 0.8 * lips["opening"]
    assert jaw["teeth"] < 0.4 * jaw["opening"]


def test_stretch_widens_pucker_narrows_and_protrudes(measured):
    assert measured(mouthStretch=0.4)["width"] > 3
    pucker = measured(mouthPucker=0.6)
    assert pucker["width"] < -3 and pucker["protrusion"] > 3


def test_the_lower_lip_of_f_lies_on_the_teeth(measured):
    assert measured(**TOUCH_POSE)["tuck"] < 0.8
    assert measured(jawOpen=0.3)["tuck"] > 3


def test_what_the_decoder_limits_is_not_counted(measured):
    """mouthClose does no more than undo the jaw."""
    assert measured(mouthClose=1.0)["protrusion"] == pytest.approx(
        measured(mouthClose=0.1)["protrusion"], abs=0.1
    )


def clips(decoder: Decoder, scale: float) -> list[Followed]:
    shapes = {"s": CLENCHED, "uw": {"mouthPucker": 0.6, "jawOpen": 0.1}, "aa": {"jawOpen": 0.3}}
    codes = np.repeat([code_of(decoder, shape) for shape in shapes.values()], 6, axis=0)
    phones = [Phone(name, 0.2 * i + 0.01, 0.2 * i + 0.21) for i, name in enumerate(shapes)]
    return [Followed(scale * codes, codes, phones)] * 5


def test_a_flat_mouth_fails_and_the_truth_holds(decoder, capsys, tmp_path):
    def held(scale: float) -> dict[str, bool]:
        said = articulation.tokens_of({"somebody": clips(decoder, scale)}, AVATAR)
        articulation.show(said)
        assert articulation.save_plot(tmp_path, said).stat().st_size > 10_000
        named = {f"{articulation.ROW}/{name}": value for name, value in figures(said).items()}
        return {row["name"]: row["ok"] for row in articulation.thresholds(named)}

    truth = held(1.0)
    assert len(truth) == 6 and all(truth.values())
    assert "s z" in capsys.readouterr().out
    flat = held(0.05)
    assert not any(ok for name, ok in flat.items() if "contrast" in name or "teeth" in name)
    assert not flat["open vowels shown shut"]
