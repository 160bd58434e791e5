"""Which stage of training takes which option."""

from typing import get_args

from app.terminal.arguments import check_taken
from app.train.settings import Baseline, Stage, TrainSettings
from sensors.types import InputError

NETWORKS = tuple(stage for stage in get_args(Stage) if stage not in ("landmarks", "gaze"))
OF_ENCODER = tuple(stage for stage in NETWORKS if stage != "prior")
# option: the stages that take it
TAKEN_BY = {
    "name": ("peers",),
    "leave_out": ("diffusion", "distill", "listen", "voice-activity", "contact"),
    "teacher": ("audio",),
    "phones": ("listen",),
    "start": tuple(stage for stage in OF_ENCODER if stage != "peers"),
    "face": ("prior", "landmarks"),
    "take": ("prior",),
    "device": NETWORKS,
    "stream_minutes": ("diffusion", "distill", "contact", "regression", "emotion", "peers"),
    **dict.fromkeys(("steps", "resume", "precision", "compile"), OF_ENCODER),
    **dict.fromkeys(("preset", "data", "seed"), (*NETWORKS, "gaze")),
}


def check(settings: TrainSettings) -> None:
    """Raises InputError where the stage does not take an option, or lacks one."""
    check_taken(settings, TAKEN_BY, settings.stage, "stages")
    if settings.stage == "peers" and settings.name is None:
        known = ", ".join(get_args(Baseline))
        raise InputError(f"train peers: expected --name and one of {known}, got none; give one")
