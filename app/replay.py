"""`livedrive replay SESSION`: a recorded session becomes a talking head."""

from dataclasses import dataclass
from pathlib import Path

import tyro

from app.options import DriveOptions
from sensors.types import FPS, NS, InputError


@dataclass(kw_only=True)
class Replay(DriveOptions):
    """Drive the head from a recorded session."""

    session: tyro.conf.Positional[Path]
    """Folder of the session, e.g. recordings/demo."""
    fast: bool = False
    """As fast as the machine can (the default)."""
    realtime: bool = False
    """At the pace of the recording; late pictures are dropped, steps never."""

    def run(self) -> None:
        if self.fast and (self.realtime or self.window):
            other = "--realtime" if self.realtime else "--window"
            raise InputError(f"pace: expected --fast or {other}, got both; give one")
        from app.calibration import of_session
        from app.sinks.progress import ProgressSink
        from sensors.clock import MonotonicClock
        from sensors.recording import Recording
        from sensors.replay import ReplaySource

        recording, clock = Recording(self.session), MonotonicClock()
        driver = self.load_driver(has_eyes=bool(recording.eyes))
        driver.calibration = of_session(recording)
        eyes = self.window or driver.config.condition == "eyes"
        realtime = self.realtime or self.window or (self.is_networked and not self.fast)
        report = self.drive(
            ReplaySource(recording, clock, realtime, eyes=eyes),
            driver,
            clock,
            realtime=realtime,
            # Codes alone need no picture; --realtime always draws, as a live run does.
            draw=self.realtime or self.report is not None,
            title="/".join(self.session.parts[-2:]),
            frames=recording.duration_ns * FPS // NS,
            more_sinks=[ProgressSink()],
        )
        self.finish(report)
