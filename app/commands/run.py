"""`livedrive run`: microphone and eye cameras drive the head, live."""

import shlex
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from app.commands.live import LiveOptions, ends_on_signals
from app.commands.options import DriveOptions
from sensors.types import InputError


@dataclass(kw_only=True)
class Run(LiveOptions, DriveOptions):
    """Drive the head from the microphone and the eye cameras.

    Options that you always give can stand in ~/.config/livedrive/run.toml, e.g. mic = "Beyond".
    """

    headless: bool = False
    """Open no window."""
    record: Path | None = None
    """Record a session into this folder, to be replayed to the same codes."""

    def run(self) -> None:
        if self.headless and self.window:
            raise InputError("window: expected --headless or --window, got both; give one")
        self.window = not self.headless
        from app.compose.build import build, load_driver
        from app.compose.live import live_source, open_page, open_recorder, tell
        from app.compose.report import finish, report, sensor_report
        from app.drive.calibration import in_session, of_user
        from app.drive.loop import drive
        from app.drive.tape import Tape
        from app.sinks.dashboard import Dashboard
        from app.sinks.live_stats import LiveStats
        from app.sinks.sensor_notes import SensorNotes, is_needed
        from sensors.audio.portaudio import silence_native_messages
        from sensors.clock import MonotonicClock

        live, clock, stats = self.live_settings(), MonotonicClock(), LiveStats()
        settings = self.settings(
            realtime=True,
            draw=False,
            title="live",
            head=live.head_mode,
            web_microphone=self.mic == "web",
            web_head=self.head in ("auto", "web"),
        )
        page = open_page(settings, clock)
        source = live_source(live, clock, page)
        driver = load_driver(settings, bool(source.info.eyes), of_user())
        recorder = partial(open_recorder, source=source, calibration=in_session(driver))
        tape = Tape(self.record, recorder)
        notes = [SensorNotes(source, tell)] if is_needed() else []
        silence_native_messages()
        try:
            with ends_on_signals(source) as signals:
                parts = build(
                    settings,
                    source=source,
                    driver=driver,
                    clock=clock,
                    sinks=[stats, Dashboard(source, stats), *notes],
                    tape=tape,
                    page=page,
                )
                summary = drive(parts)
        finally:
            tape.close()
        values = report(settings, parts, summary) | stats.report()
        values |= {"sensors": sensor_report(source)}
        values["recording"] = tape.problem or ("complete" if tape.sessions else "none")
        finish(values, self.report, settings.files.written)
        for session in () if tape.problem else tape.sessions:
            next_words = shlex.join(["livedrive", "replay", str(session)])
            print(f"wrote {session.resolve()}; next: {next_words}")
        if signals:
            raise KeyboardInterrupt
