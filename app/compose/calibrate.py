"""Eye samples of a person following the calibration routine, live or recorded."""

from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from app.drive.eye_routine import collect, words_of
from sensors.types import LOOPBACK, NS, Clock, InputError

if TYPE_CHECKING:
    from app.web.sink import WebSink
    from encoder.eyes.routine import RoutineStep, TargetSamples

AVATAR = "ben"  # of the page's server; nobody is shown


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
    return collect(source, load_eye_encoder(WEIGHTS), clock, lambda _: None, live=False)


def takes_of_cameras(
    specs: Sequence[str], port: int | None = None, host: str = LOOPBACK
) -> "list[TargetSamples]":
    """The terminal names the targets; with `port`, a page there shows them, on a screen or in a
    headset. Raises InputError where a camera cannot be used, or the page."""
    from encoder.eyes.encoder import load_eye_encoder
    from encoder.inference import WEIGHTS
    from sensors.cameras.spec import cameras
    from sensors.clock import MonotonicClock
    from sensors.live.source import LiveSource

    clock = MonotonicClock()
    eyes, encoder = cameras(specs, clock), load_eye_encoder(WEIGHTS)
    source = LiveSource(None, eyes, clock)

    def name(target: "RoutineStep") -> None:
        print(words_of(target), flush=True)

    def problems() -> str:
        return ", ".join(f"{eye.name}: {eye.problem}" for eye in eyes if eye.problem)

    if port is None:
        return collect(source, encoder, clock, name, live=True, problems=problems)
    with _page(host, port, clock) as page:

        def show(target: "RoutineStep") -> None:
            name(target)
            page.link.say(target={**asdict(target), "words": words_of(target)})

        return collect(source, encoder, clock, show, live=True, problems=problems)


@contextmanager
def _page(host: str, port: int, clock: Clock) -> "Generator[WebSink]":
    """The page of the targets, at which somebody is ready."""
    from app.drive.sink import RunInfo
    from app.web.info import ServerInfo
    from app.web.sink import WebSink

    page = WebSink(ServerInfo(host, port, AVATAR, gaussians="16k", targets=True), clock)
    try:
        page.on_start(RunInfo(0, 0, None))
        print("open it where you will look, and press Start, or Enter VR in a headset", flush=True)
        while not page.link.status.get("watching"):
            page.link.read()
            if page.link.ended:
                raise InputError("calibrate --web: the page's server has ended; try again")
            clock.sleep_until_ns(clock.now_ns() + NS // 50)
        yield page
    finally:
        page.close()
