"""`livedrive replay SESSION`: a recorded session becomes a talking head."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from app.commands.options import DriveOptions
from sensors.types import InputError


@dataclass(kw_only=True)
class Replay(DriveOptions):
    """Drive the head from a recorded session."""

    session: tyro.conf.Positional[Path]
    """Folder of the session, e.g. recordings/demo."""
    fast: bool = False
    """As fast as the machine can (the default)."""
    head: Literal["auto", "synth", "still"] = "auto"
    """What moves the head: auto (as recorded, else from speech), synth (from speech), still."""
    realtime: bool = False
    """At the pace of the recording; late pictures are dropped, steps never."""

    def run(self) -> None:
        if self.fast and (self.realtime or self.window):
            other = "--realtime" if self.realtime else "--window"
            raise InputError(f"pace: expected --fast or {other}, got both; give one")
        from app.compose.replay import replay
        from app.compose.report import finish
        from app.sinks.progress import ProgressSink

        networked = bool(self.send) or self.web is not None
        settings = self.settings(
            realtime=self.realtime or self.window or (networked and not self.fast),
            # Codes alone need no picture; --realtime always draws, as a live run does.
            draw=self.realtime or self.report is not None,
            title="/".join(self.session.parts[-2:]),
            head=self.head,
        )
        report = replay(self.session, settings, [ProgressSink()])
        finish(report, self.report, settings.files.written)
