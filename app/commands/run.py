"""`livedrive run`: microphone and eye cameras drive the head, live."""

import shlex
from dataclasses import dataclass

from app.commands.live import LiveDriveOptions, ends_on_signals
from app.terminal.arguments import File


@dataclass(kw_only=True)
class Run(LiveDriveOptions):
    """Drive the head from the microphone and the eye cameras.

    Options that you always use can go into ~/.config/livedrive/run.toml, e.g. mic = "Beyond".
    """

    record: File = None
    """Record a session into this folder; a replay of it gives the same codes."""

    def run(self) -> None:
        settings = self.live_drive_settings("live")
        from app.compose.live import tell
        from app.compose.live_run import LiveRun
        from app.compose.report import finish
        from app.drive.loop import drive
        from app.drive.tape import Tape
        from app.sinks.dashboard import Dashboard
        from app.sinks.sensor_notes import SensorNotes, is_needed

        run = LiveRun(self.live_settings(), settings)
        tape = Tape(self.record, run.open_recorder)
        notes = [SensorNotes(run.source, tell)] if is_needed() else []
        try:
            with ends_on_signals(run.source) as signals:
                parts = run.build(tape, [Dashboard(run.source, run.stats), *notes])
                summary = drive(parts)
        finally:
            tape.close()
        values = run.report(parts, summary)
        values["recording"] = tape.problem or ("complete" if tape.sessions else "none")
        finish(values, self.report, settings.files.written)
        for session in () if tape.problem else tape.sessions:
            next_words = shlex.join(["livedrive", "replay", str(session)])
            print(f"wrote {session.resolve()}; next: {next_words}")
        if signals:
            raise KeyboardInterrupt
