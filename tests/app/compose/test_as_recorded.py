"""A replay moves the head as the run did, unless it is told otherwise."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from app.compose.replay import as_recorded
from app.compose.settings import DriveSettings


@pytest.mark.parametrize(
    ("card", "asked", "used"),
    [
        ({"calibration": {"head": "track"}}, "auto", "track"),
        ({"calibration": {"head": "still"}}, "auto", "still"),
        ({"calibration": {"head": "track"}}, "synth", "synth"),
        ({"calibration": {}}, "auto", "auto"),
        ({}, "still", "still"),
        ({"calibration": {"head": ["track"]}}, "auto", "auto"),
        ({"calibration": {"head": "rm -rf"}}, "auto", "auto"),
    ],
)
def test_the_head_moves_as_recorded(card: dict[str, Any], asked: Any, used: str) -> None:
    recording: Any = SimpleNamespace(card=card)
    assert as_recorded(DriveSettings(head=asked), recording).head == used


@pytest.mark.parametrize(
    ("recorded", "asked", "used"),
    [
        ("eyes", "auto", "eyes"),  # also where no camera brought a picture
        ("gaze", "auto", "gaze"),
        ("eyes", "gaze", "gaze"),
        ("ears", "auto", "auto"),
        (["eyes"], "auto", "auto"),
    ],
)
def test_the_upper_face_is_driven_as_recorded(recorded: Any, asked: Any, used: str) -> None:
    """Red before: a run whose cameras brought nothing was replayed by another student."""
    recording: Any = SimpleNamespace(card={"calibration": {"condition": recorded}})
    assert as_recorded(DriveSettings(condition=asked), recording).condition == used


@pytest.mark.parametrize(
    ("recorded", "asked", "used"),
    [
        (7, None, 7),
        (7, 0, 0),
        (7, 3, 3),
        (-1, None, None),
        ("7", None, None),
        (1 << 63, None, None),
    ],
)
def test_what_is_drawn_at_random_is_as_recorded(recorded: Any, asked: Any, used: Any) -> None:
    """Red before: `run --seed 7 --record` did not replay to the same codes."""
    recording: Any = SimpleNamespace(card={"calibration": {"seed": recorded}})
    assert as_recorded(DriveSettings(seed=asked), recording).seed == used


def test_without_weights_that_see_it_stays_open(tmp_path: Path) -> None:
    recording: Any = SimpleNamespace(card={"calibration": {"condition": "eyes"}})
    assert as_recorded(DriveSettings(weights=tmp_path), recording).condition == "auto"
