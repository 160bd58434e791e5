"""`--weights FOLDER` of `run` and `replay`: the networks that a user trained drive the head."""

import shutil
from pathlib import Path

import pytest

from app.compose.build import load_driver
from app.compose.settings import DriveSettings
from encoder.inference import WEIGHTS
from encoder.nn import checkpoint
from sensors.types import InputError


def test_networks_of_a_folder_drive(tmp_path: Path) -> None:
    """Red without `weights` in load_driver. A folder without eyes: the sound alone drives."""
    for suffix in (".json", ".safetensors"):
        shutil.copy((WEIGHTS / "audio").with_suffix(suffix), tmp_path)
    tensors, card = checkpoint.load(WEIGHTS / "student", "student")
    tensors["expression_mean"] = tensors["expression_mean"] + 1
    checkpoint.save(tmp_path / "student", tensors, card)
    mine = load_driver(DriveSettings(weights=tmp_path, device="cpu"), has_eyes=True)
    shipped = load_driver(DriveSettings(device="cpu"), has_eyes=False)
    assert mine.mean == pytest.approx(shipped.mean + 1)
    assert mine.eyes is None


def test_a_folder_without_networks_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=str(tmp_path)):
        load_driver(DriveSettings(weights=tmp_path, device="cpu"), has_eyes=False)


def test_eyes_without_cameras_are_told(capsys: pytest.CaptureFixture[str]) -> None:
    """Red before: not a word."""
    load_driver(DriveSettings(condition="eyes", device="cpu"), has_eyes=False)
    assert "there are none" in capsys.readouterr().err
    load_driver(DriveSettings(device="cpu"), has_eyes=False)
    assert not capsys.readouterr().err
