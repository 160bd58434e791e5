"""A recorded session, driven from its first packet to its last, or over and over for a page."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from app.compose.build import build, load_driver
from app.compose.live import open_page, tell
from app.compose.report import report
from app.compose.settings import CONDITION, HEAD_MODE, MAX_SEED, SEED, DriveSettings, HeadMode
from app.drive.calibration import of_session
from app.drive.loop import Drive, Summary, drive
from app.drive.sink import Sink

if TYPE_CHECKING:
    from encoder.driver import Driver
    from sensors.session.playback import Playback
    from sensors.session.recording import Recording


class Stopped(KeyboardInterrupt):
    """Ctrl-C, with the report of what was driven until then."""

    def __init__(self, report: dict[str, Any]) -> None:
        super().__init__()
        self.report = report


def replay(session: Path, settings: DriveSettings, sinks: Sequence[Sink] = ()) -> dict[str, Any]:
    """Drive the session with the calibration it was recorded with, and return the report. Raises
    Stopped on Ctrl-C."""
    from sensors.clock import MonotonicClock
    from sensors.session.replay import ReplaySource

    (recording, settings, driver), clock = _opened(session, settings), MonotonicClock()
    eyes = settings.window or driver.config.condition == "eyes"  # the window shows the videos
    source = ReplaySource(recording, clock, settings.realtime, eyes=eyes)
    parts = build(settings, source=source, driver=driver, clock=clock, sinks=sinks)
    values = _driven(settings, parts)
    if source.missing:
        tell(source.missing)
    return values


def play(
    session: Path, settings: DriveSettings, controlled: "Callable[[Playback], None]"
) -> dict[str, Any]:
    """Drive the session for the page of the settings, from the first viewer on and over and over,
    until `controlled`, which gets the playback at the start, stops it. Raises Stopped on Ctrl-C."""
    from sensors.clock import MonotonicClock
    from sensors.session.playback import Playback

    (recording, settings, driver), clock = _opened(session, settings), MonotonicClock()
    page = open_page(settings, clock)
    assert page is not None
    link = page.link

    def nobody_watches() -> bool:
        link.read()
        return not link.status.get("pages") and not link.ended

    eyes = driver.config.condition == "eyes"
    source = Playback(recording, clock, eyes=eyes, waits=nobody_watches)
    parts = build(settings, source=source, driver=driver, clock=clock, page=page)
    tell("the session begins when somebody opens the page, and begins anew at its end")
    controlled(source)
    return _driven(settings, parts)


def _driven(settings: DriveSettings, parts: Drive) -> dict[str, Any]:
    """The report; on Ctrl-C raises Stopped, when all files are finished, or as it is before the
    first frame."""
    summary = Summary()
    try:
        drive(parts, summary)
    except KeyboardInterrupt:
        if not summary.frames:
            raise
        raise Stopped(report(settings, parts, summary)) from None
    return report(settings, parts, summary)


def _opened(session: Path, settings: DriveSettings) -> "tuple[Recording, DriveSettings, Driver]":
    """The session, and what drives it as it was recorded; InputError where it holds no frame."""
    from sensors.session.recording import Recording

    recording = Recording(session)
    recording.check_frames()
    settings = as_recorded(settings, recording)
    driver = load_driver(settings, bool(recording.eyes), of_session(recording))
    return recording, settings, driver


def as_recorded(settings: DriveSettings, recording: "Recording") -> DriveSettings:
    """What is left open is as in the run: what moves the head, also where its tracker paused, the
    upper face, also where its cameras brought no picture, and what is drawn at random. Older
    sessions, and those of `record`, do not say what that was."""
    from encoder import inference

    known = recording.card.get("calibration", {})
    mode, condition = known.get(HEAD_MODE), known.get(CONDITION)
    if settings.head == "auto" and mode in get_args(HeadMode):
        settings = replace(settings, head=mode)
    weights = settings.weights or inference.WEIGHTS
    can = condition == "gaze" or (condition == "eyes" and inference.eyes_fit(weights))
    if settings.condition == "auto" and can:
        settings = replace(settings, condition=condition)
    seed = known.get(SEED)
    if settings.seed is None and isinstance(seed, int) and 0 <= seed < MAX_SEED:
        settings = replace(settings, seed=int(seed))
    return settings
