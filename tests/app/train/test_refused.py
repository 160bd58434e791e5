"""What `livedrive train` refuses before it works for minutes."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.commands.train import Train
from app.eval import prior
from app.train import landmarks
from render.training.data import face_data
from sensors.types import InputError


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"steps": 0}, "--steps: expected 1 or more, got 0; leave it out"),
        ({"steps": -3}, "--steps: expected 1 or more, got -3"),
        ({"stream_minutes": float("nan")}, "--stream-minutes: expected more than 0, got nan"),
        ({"stream_minutes": -1.0}, "--stream-minutes: expected more than 0, got -1"),
    ],
)
def test_training_by_nothing_is_refused(given: dict[str, Any], told: str, tmp_path: Path) -> None:
    """Red before: untrained weights took the place of others, a stream was made; a traceback."""
    with pytest.raises(InputError, match=told):
        Train(stage="audio", data=tmp_path, out=tmp_path, **given).run()


@pytest.mark.parametrize(
    ("given", "told"),
    [
        # red before: minutes of work, then half of what was asked for, without a word; an error
        ({"face": "nope"}, "face data: expected .*nope.*; give the folder with --face DIR"),
        ({"out": "file"}, "--out: expected a folder to write into, got .*file"),
    ],
)
def test_landmarks_are_not_begun_where_they_cannot_be_written(
    given: dict[str, str], told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(landmarks, "make_table", lambda out: None)
    monkeypatch.setattr(landmarks, "make_shapes", lambda data, table, out: None)
    if "out" in given:
        monkeypatch.setattr(face_data, "load", lambda face: None)
    (tmp_path / "file").touch()
    places = {"face": "face", "out": "out"} | given
    with pytest.raises(InputError, match=told):
        Train(stage="landmarks", **{k: tmp_path / v for k, v in places.items()}).run()


def test_how_people_differ_is_learned_at_the_places_just_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Red before: with --out at those of the shipped table, from which the new ones differ."""
    taken = list[object]()
    monkeypatch.setattr(landmarks, "make_table", lambda out: "places")
    monkeypatch.setattr(landmarks, "make_shapes", lambda *given: taken.extend(given))
    monkeypatch.setattr(face_data, "load", lambda face: "face")
    landmarks.make(tmp_path, tmp_path)
    assert taken == ["face", "places", tmp_path]


@pytest.mark.parametrize(
    ("stage", "given"),
    [
        ("landmarks", {"preset": "debug"}),
        ("landmarks", {"resume": True}),
        ("landmarks", {"device": "cuda"}),
        ("prior", {"precision": "bfloat16"}),
        ("gaze", {"start": Path("weights")}),
        ("audio", {"take": Path("take.csv")}),
        ("listen", {"stream_minutes": 60.0}),
        ("multimodal", {"stream_minutes": 60.0}),
        ("peers", {"name": "talkshow", "start": Path("weights")}),  # red before: a traceback
    ],
)
def test_what_a_stage_does_not_take_is_told(
    stage: Any, given: dict[str, Any], tmp_path: Path
) -> None:
    """Red before: it went unheard."""
    name = list(given)[-1].replace("_", "-")
    with pytest.raises(InputError, match=f"--{name}: expected one of the stages .*, got {stage}"):
        Train(stage=stage, out=tmp_path, **given).run()


def test_a_folder_that_cannot_be_written_is_told_before_training(tmp_path: Path) -> None:
    """Red before: after it, which may be hours."""
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="file.* choose another"):
        Train(stage="audio", data=tmp_path / "no data", out=tmp_path / "file").run()


@pytest.mark.parametrize("is_whole", [False, True])
def test_damaged_face_data_is_told_in_a_line(is_whole: bool, tmp_path: Path) -> None:
    """Red before: a traceback, of zipfile or of the first array that it lacks."""
    path = tmp_path / "ict_face.npz"
    np.savez(path, neutral=np.zeros((4, 3), np.float32))
    if not is_whole:
        path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(InputError, match=r"ict_face\.npz: expected a whole npz file, got .*; get"):
        face_data.load(tmp_path)


def test_face_data_without_a_scan_are_told_in_a_line(tmp_path: Path) -> None:
    """Red before: a traceback at the end of `eval prior`, and of `eval photos`."""
    np.savez(tmp_path / face_data.FILE, neutral=np.zeros((4, 3), np.float32))
    face = face_data.FaceData(
        tmp_path, **dict.fromkeys(list(face_data.FaceData.__annotations__)[1:])
    )  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"ict_face\.npz: expected .*ident_lps.*; get the face"):
        face.scan()


def test_a_prior_without_avatars_is_not_judged(tmp_path: Path) -> None:
    """Of a run that was stopped. Red before: a traceback after a minute."""
    with pytest.raises(InputError, match="--weights: expected avatars .* got none; let livedrive"):
        prior.evaluate(prior.PriorSettings(weights=tmp_path))


def test_eyes_and_sound_name_the_stage_that_hears_first(tmp_path: Path) -> None:
    """Red before: expected a file or folder streams.npz, got none; check the path."""
    with pytest.raises(InputError, match=r"streams\.npz: .* `livedrive train diffusion`"):
        Train(stage="multimodal", data=tmp_path, out=tmp_path).run()
