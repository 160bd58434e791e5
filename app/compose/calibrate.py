"""Eye samples of a person following the calibration routine, live or recorded."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from app.drive.eye_routine import collect
from sensors.types import InputError

if TYPE_CHECKING:
    from encoder.eyes.routine import TargetSamples


def takes_of_session(session: Path) -> "list[TargetSamples]":
    """Raises InputError where the session has no pictures of eyes, or too few."""
    from encoder.eyes.encoder import load_eye_encoder
    from encoder.inference import WEIGHTS
    from sensors.clock import MonotonicClock
    from sensors.session.recording import Recording
    from sensors.session.replay import ReplaySource

    recording, clock = Recording(session), MonotonicClock()
    if not recording.eyes:
        raise InputError(
            f"calibrate: expected a session with pictures of the eyes, got none in {session}; "
            "record one with livedrive record DIR --eyes SPEC"
        )
    source = ReplaySource(recording, clock, realtime=False, eyes=True)
    return collect(source, load_eye_encoder(WEIGHTS), clock, print, live=False)


def takes_of_cameras(specs: Sequence[str]) -> "list[TargetSamples]":
    """Raises InputError where a camera cannot be used."""
    from encoder.eyes.encoder import load_eye_encoder
    from encoder.inference import WEIGHTS
    from sensors.cameras.spec import cameras
    from sensors.clock import MonotonicClock
    from sensors.live.source import LiveSource

    clock = MonotonicClock()
    source = LiveSource(None, cameras(specs, clock), clock)
    return collect(source, load_eye_encoder(WEIGHTS), clock, print, live=True)
