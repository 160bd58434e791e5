"""`livedrive eval emotion`: thresholds and tables of known metrics, pictures of a confusion."""

from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from app.eval.emotion import pictures as emotion_pictures
from app.eval.emotion.evaluate import make_thresholds, show
from app.eval.emotion.metrics import Confusion, load_model
from encoder.denoiser.config import DenoiserConfig
from encoder.denoiser.model import Denoiser
from encoder.emotion.labels import LABELS
from encoder.inference import WEIGHTS
from encoder.nn import checkpoint
from sensors.types import InputError

OURS = {
    "accuracy_face": 0.9,
    "lip_sync_mm": 2.0,
    "neutral_lip_sync_mm": 1.95,
    "neutral_own_lip_sync_mm": 1.8,
    "lip_motion_error": 0.80,
    "neutral_lip_motion_error": 0.79,
    "neutral_own_lip_motion_error": 0.78,
    "neutral_closures_lost": 0.05,
    "neutral_closures_lost_error": 0.012,
    "neutral_own_closures_lost": 0.02,
    "neutral_own_closures_lost_error": 0.012,
    "closures": 700.0,
}
LAID = {"lip_sync_mm": 1.8, "lip_motion_error": 0.78}
TUNED = {"accuracy_face": 0.88, "lip_sync_mm": 2.2, "lip_motion_error": 0.75}
METRICS = {
    **{f"acted voice/zero convolutions/{name}": value for name, value in OURS.items()},
    **{f"acted voice/rules over neutral/{name}": value for name, value in LAID.items()},
    **{f"acted voice/fine-tuned/{name}": value for name, value in TUNED.items()},
    "intensity_0_difference": 0.0,
    "intensity_monotone_share": 0.9,
    "lids_apart_p95": 0.2,
    "switching_jump_over_normal": 0.8,
    "switching_jump_over_steady": 1.1,
    "emotion_cpu_ms_a_tick": 0.1,
}


def test_convolutions_of_a_student_of_other_sizes_are_named(tmp_path: Path) -> None:
    """Red before: a traceback of torch. `train emotion --out W` extends the shipped student."""
    config = DenoiserConfig(layers=1, dim=32, heads=2, ff_dim=64)
    student = {"kind": "student", "config": asdict(config)}
    checkpoint.save(tmp_path / "student", Denoiser(config).state_dict(), student)
    with pytest.raises(InputError, match=r"of another student; run .* --start"):
        load_model(tmp_path / "student", WEIGHTS / "emotion")


def test_bars_hold_the_issue_s_limits() -> None:
    thresholds = {bar["name"]: bar["ok"] for bar in make_thresholds(METRICS, ["acted voice"])}
    assert thresholds == {
        "acted voice accuracy": True,
        "acted voice lip sync over neutral's on emotional truth": True,
        "acted voice lip motion over neutral's on emotional truth": True,
        "acted voice lip sync over neutral's on its own truth": False,  # 11 %
        "acted voice lip motion over neutral's on its own truth": True,
        "acted voice lip sync over neutral's in the rules' style": False,  # 11 %
        "acted voice lip motion over neutral's in the rules' style": True,
        "acted voice closures lost, emotional truth (of 700, +-0.012)": False,  # 5 points
        "acted voice closures lost, its own truth (of 700, +-0.012)": True,
        "acted voice accuracy that fine-tuning lacks": True,
        "acted voice lip sync over fine-tuned": True,
        "acted voice lip motion over fine-tuned": False,
        "intensity_0_difference": True,
        "intensity_monotone_share": False,
        "lids_apart_p95": False,
        "switching_jump_over_normal": True,
        "switching_jump_over_steady": False,
        "emotion_cpu_ms_a_tick": True,
    }


def test_a_row_that_lacks_a_figure_is_shown(capsys: pytest.CaptureFixture[str]) -> None:
    show({"acted voice": {"zero convolutions": {"accuracy_face": 0.912}}})
    out = capsys.readouterr().out
    assert "0.912" in out and "-" in out


@pytest.mark.slow
def test_pictures(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    table = np.eye(len(LABELS))
    seen = {"acted voice": Confusion(dict.fromkeys(("face", "upper", "lower"), table))}
    emotion_pictures._confusions(tmp_path / "confusion.png", seen)  # noqa: SLF001
    rows = [[np.full((224, 224, 3), 40 * k, np.uint8)] * 5 for k in range(3)]
    emotion_pictures._sheet(tmp_path / "sheet.png", rows, ["a", "b", "c"])  # noqa: SLF001
    assert Image.open(tmp_path / "sheet.png").size == (5 * 224, 3 * 224)
    assert (tmp_path / "confusion.png").stat().st_size > 20_000
