"""What `livedrive train` says to type next."""

from pathlib import Path
from typing import Any, get_args

import pytest

from app.train.next_step import next_command
from app.train.settings import Stage, TrainSettings


@pytest.mark.parametrize("stage", [s for s in get_args(Stage) if s != "landmarks"])
def test_every_stage_has_one(stage: Any) -> None:
    assert next_command(TrainSettings(stage=stage)).startswith("livedrive ")


@pytest.mark.parametrize(
    ("settings", "command"),
    [
        (TrainSettings(stage="audio"), "train diffusion --data data"),
        (
            TrainSettings(stage="distill", data=Path("my data"), out=Path("w"), preset="debug"),
            "train contact --data 'my data' --preset debug --out w",
        ),
        (
            TrainSettings(stage="multimodal", out=Path("w")),
            "train emotion --data data --start w --out w",
        ),
        (
            TrainSettings(stage="emotion", out=Path("w")),
            "train listen --data data --start w --out FOLDER",
        ),
        (TrainSettings(stage="voice-activity", out=Path("w")), "eval rest --weights w"),
        (
            TrainSettings(stage="listen", leave_out=("grid-s2",)),
            "eval speech data --leave-one-out --mocap DIR",
        ),
        (
            TrainSettings(stage="prior", face=Path("my face"), take=Path("t.csv"), out=Path("w")),
            # red before: without the take, and of the shipped weights
            "eval prior --face 'my face' --take t.csv --weights w",
        ),
        (TrainSettings(stage="distill", variant="no-dmd"), "eval speech data --ablations"),
        (  # red before: eval speech, which knows of no emotion
            TrainSettings(stage="emotion", variant="fine-tune", data=Path("my data")),
            "eval emotion 'my data'",
        ),
    ],
)
def test_it_goes_on_with_what_was_made(settings: TrainSettings, command: str) -> None:
    assert next_command(settings) == f"livedrive {command}"
