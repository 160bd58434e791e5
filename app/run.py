"""`livedrive run`: microphone and eye cameras drive the head, live."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from app.live import LiveOptions, ends_on_signals, open_recorder, sensor_report
from app.options import DriveOptions
from sensors.types import InputError

if TYPE_CHECKING:
    from app.web.microphone import WebMicrophone
    from app.web.sink import WebSink


@dataclass(kw_only=True)
class Run(LiveOptions, DriveOptions):
    """Drive the head from the microphone and the eye cameras."""

    headless: bool = False
    """Open no window."""
    record: Path | None = None
    """Record a session into this folder, to be replayed to the same codes."""

    def run(self) -> None:
        if self.headless and self.window:
            raise InputError("window: expected --headless or --window, got both; give one")
        self.window = not self.headless
        from app.calibration import in_session, of_user
        from app.dashboard import Dashboard
        from app.live_stats import LiveStats
        from app.tape import Tape
        from sensors.clock import MonotonicClock
        from sensors.portaudio import silence_native_messages

        clock = MonotonicClock()
        page = self.open_web(clock, self.avatar, self.gaussians, microphone=self.mic == "web")
        source = self.live_source(clock, self._web_microphone(page))
        driver = self.load_driver(has_eyes=bool(source.info.eyes))
        driver.calibration = of_user()
        calibration = in_session(driver)
        tape = Tape(self.record, partial(open_recorder, source=source, calibration=calibration))
        stats = LiveStats()
        silence_native_messages()
        try:
            with ends_on_signals(source) as signals:
                report = self.drive(
                    source,
                    driver,
                    clock,
                    realtime=True,
                    draw=False,
                    live=True,
                    more_sinks=[stats, Dashboard(source, stats)],
                    tape=tape,
                    page=page,
                )
        finally:
            tape.close()
        report |= stats.report() | {"sensors": sensor_report(source)}
        report["recording"] = tape.problem or ("complete" if tape.sessions else "none")
        self.finish(report)
        for session in () if tape.problem else tape.sessions:
            print(f"wrote {session.resolve()}; next: livedrive replay {session}")
        if signals:
            raise KeyboardInterrupt

    def _web_microphone(self, page: "WebSink | None") -> "WebMicrophone | None":
        if self.mic != "web":
            return None
        if page is None:
            raise InputError("--mic web: expected a page, got none; try --web 8443 --mic web")
        from app.web.microphone import WebMicrophone

        return WebMicrophone(page.link)
