"""Judging real eye videos: labels, the pupil's fit, and numbers from what was shown."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.eval.eyes.labels import SHIPPED, Label, inside, load_labels
from app.eval.eyes.real import RealClip, clip_metrics, real_metrics
from sensors.types import InputError


def write(folder: Path, *clips: dict[str, object], version: int = 1) -> Path:
    (folder / "labels.json").write_text(json.dumps({"format": version, "clips": clips}))
    (folder / "a.mkv").write_bytes(b"")
    return folder


def test_labels_are_lists_of_frames(tmp_path: Path) -> None:
    [label] = load_labels(write(tmp_path, {"name": "a", "right": "a.mkv", "blinks": [[3, 5]]}))
    assert label.videos == (None, tmp_path / "a.mkv") and label.blinks == ((3, 5),)
    assert np.flatnonzero(inside(label.blinks, 10)).tolist() == [3, 4, 5]
    assert np.flatnonzero(inside(label.blinks, 7, 2)).tolist() == [1, 2, 3, 4, 5, 6]


@pytest.mark.parametrize(
    "clip",
    [{"name": "a"}, {"left": "a.mkv"}, {"name": "a", "left": "a.mkv", "blinks": [[5, 3]]},
     {"name": "a", "left": "a.mkv", "partial": [1, 2, 3]}],
)  # fmt: skip
def test_odd_labels_are_one_line(tmp_path: Path, clip: dict[str, object]) -> None:
    with pytest.raises(InputError, match="expected format 1"):
        load_labels(write(tmp_path, clip))


def test_labels_without_their_videos_are_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="found none"):
        load_labels(tmp_path)
    with pytest.raises(InputError, match="expected format 1"):
        load_labels(write(tmp_path, version=2))
    assert json.loads(SHIPPED.read_text())["clips"]


def test_the_pupil_is_found_between_glints_and_lashes() -> None:
    pytest.importorskip("cv2")
    from app.eval.eyes.pupil import find_pupil

    rows, columns = np.mgrid[:240, :320].astype(np.float32)
    rng = np.random.default_rng(0)
    picture = np.full((240, 320), 150.0)
    picture[(columns - 170) ** 2 + (rows - 120) ** 2 < 75**2] = 90  # iris
    picture[(columns - 180) ** 2 + ((rows - 112) * 1.1) ** 2 < 30**2] = 15
    picture[(columns - 190) ** 2 + (rows - 100) ** 2 < 5**2] = 255  # glint
    picture[:40, ::9] = 30  # lashes
    found = find_pupil(np.clip(picture + rng.normal(0, 4, picture.shape), 0, 255).astype(np.uint8))
    assert found.good and abs(found.x - 180) < 2 and abs(found.y - 112) < 2
    assert 25 < found.radius < 34
    flat = rng.integers(100, 104, (240, 320)).astype(np.uint8)
    assert not find_pupil(flat).good


def shown(label: Label, frames: int = 120) -> RealClip:
    """A left eye that follows its pupil, and blinks as labelled."""
    place = 0.2 * np.sin(np.arange(frames)[:, None] / np.float64([7, 11]))
    place[60:] = place[60]  # and then keeps still
    gaze = np.repeat(np.concatenate([place, np.ones((frames, 1))], 1)[:, None], 2, 1)
    pupils = np.zeros((frames, 2, 4))
    pupils[:, 0, :2], pupils[:, 0, 3] = 0.5 * place + 0.3, 1
    opening = np.where(inside(label.blinks, frames), 0.1, 0.95)
    views = np.zeros((frames, 2, 400, 400), np.uint8)
    accepted = np.ones((frames, 2), bool)
    return RealClip(label, (0,), views, opening, gaze, np.stack([opening] * 2, 1), accepted,
                 accepted.astype(float), pupils)  # fmt: skip


LABEL = Label(name="a", videos=(Path("a"), None), blinks=((20, 25),), partial=((40, 44),))


def test_what_is_right_is_found_right() -> None:
    row = clip_metrics(shown(LABEL))
    assert row["accepted_share"] == 1 and row["blinks"] == 1 and row["blinks_missed"] == 0
    assert row["blinks_false"] == 0 and row["onset_delay_frames_worst"] == 0
    assert row["gaze_r_x"] > 0.999 and row["gaze_r_y"] > 0.999 and row["jitter_deg"] < 1e-6


def test_every_fault_shows_in_its_number() -> None:
    clip = shown(LABEL)
    clip.opening[20:23] = 0.95  # late
    clip.opening[80:84] = 0.1  # false
    clip.opening[40:44] = 0.3  # a partial blink counts neither way
    clip.accepted[100:] = False
    clip.gaze[:, 0, 0] *= -1
    clip.gaze[60:, 0, 1] += np.where(np.arange(60) % 2, 0.02, 0)
    row = clip_metrics(clip)
    assert row["onset_delay_frames_worst"] == 3 and row["blinks_false"] == 1
    assert 0.7 < row["accepted_share"] < 0.85 and row["gaze_r_x"] < -0.9
    assert 0.4 < row["jitter_deg"] < 0.7
    metrics = real_metrics([shown(replace(LABEL, name="b")), clip])
    assert metrics["real_blinks"] == 2 and metrics["real_gaze_r_x_worst"] == row["gaze_r_x"]
    assert metrics["real_blinks_false_per_minute"] == pytest.approx(1 / (8 / 60))
    missed = shown(LABEL)
    missed.opening[:] = 0.95
    assert clip_metrics(missed)["blinks_missed"] == 1
