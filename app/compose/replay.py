"""A recorded session, driven from its first packet to its last."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from app.compose.build import build, load_driver
from app.compose.report import report
from app.compose.settings import DriveSettings
from app.drive.calibration import of_session
from app.drive.loop import drive
from app.drive.sink import Sink


def replay(session: Path, settings: DriveSettings, sinks: Sequence[Sink] = ()) -> dict[str, Any]:
    """Drive the session with the calibration it was recorded with, and return the report."""
    from sensors.clock import MonotonicClock
    from sensors.session.recording import Recording
    from sensors.session.replay import ReplaySource

    recording, clock = Recording(session), MonotonicClock()
    driver = load_driver(settings, bool(recording.eyes), of_session(recording))
    eyes = settings.window or driver.config.condition == "eyes"  # the window shows the videos
    source = ReplaySource(recording, clock, settings.realtime, eyes=eyes)
    parts = build(settings, source=source, driver=driver, clock=clock, sinks=sinks)
    return report(settings, parts, drive(parts))
