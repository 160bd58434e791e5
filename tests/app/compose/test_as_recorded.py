"""A replay moves the head as the run did, unless it is told otherwise."""

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
