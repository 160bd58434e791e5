"""`livedrive replay SESSION`: a recorded session becomes a talking head."""

import sys
import threading
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import tyro

from app.commands.options import DriveOptions
from sensors.session.format import check_apart
from sensors.types import InputError

if TYPE_CHECKING:
    from sensors.session.playback import Playback

KEYS = "p: pause or go on, j SECONDS: jump there, q: quit; then Enter"


@dataclass(kw_only=True)
class Replay(DriveOptions):
    """Drive the head from a recorded session.

    With --web it starts when somebody opens the page, repeats, and takes keys.
    """

    session: tyro.conf.Positional[Path]
    """Folder of the session, e.g. recordings/demo."""
    fast: bool = False
    """As fast as this machine can (the default)."""
    head: Literal["auto", "synth", "still"] = "auto"
    """Head motion: auto (as recorded, else from speech), synth (from speech) or still."""
    realtime: bool = False
    """At the pace of the recording; every frame is computed, late ones are not drawn."""

    def run(self) -> None:
        shown = self.window or self.xr is not None
        if self.fast and (self.realtime or shown):
            other = "--realtime" if self.realtime else "--window" if self.window else "--xr"
            raise InputError(f"pace: expected --fast or {other}, got both; give one")
        files = (self.video, self.motion, self.arkit, self.report)
        for out in (*files, self.pictures, self.ply, self.gltf):
            if out:
                check_apart(self.session, out)
        from app.compose.replay import replay
        from app.sinks.progress import ProgressSink

        if self.web is not None and not (self.fast or self.window or self._written()):
            from app.compose.replay import play

            settings = self.settings(
                realtime=True, draw=False, title=self.session.name, head=self.head
            )
            self._finish(lambda: play(self.session, settings, _listen), [])
            return
        networked = bool(self.send) or self.web is not None
        settings = self.settings(
            realtime=self.realtime or shown or (networked and not self.fast),
            # Codes alone need no picture; --realtime always draws, as a live run does.
            draw=self.realtime or self.report is not None,
            title="/".join(self.session.parts[-2:]),
            head=self.head,
        )
        written = settings.files.written
        self._finish(lambda: replay(self.session, settings, [ProgressSink()]), written)

    def _finish(self, driven: Callable[[], dict[str, Any]], written: Sequence[Path]) -> None:
        """Also what Ctrl-C has ended has a report, and says what it wrote."""
        from app.compose.replay import Stopped
        from app.compose.report import finish

        try:
            values = driven()
        except Stopped as stopped:
            finish(stopped.report, self.report, written)
            raise
        finish(values, self.report, written)

    def _written(self) -> bool:
        """Files hold a session once, from its beginning to its end."""
        paths = (self.video, self.pictures, self.motion, self.arkit, self.ply, self.gltf)
        return any(paths) or self.virtual_camera is not None


def _listen(playback: "Playback") -> None:
    """Lines of the terminal steer it, beside the drive."""
    print(KEYS, flush=True)
    threading.Thread(target=_steer, args=(playback, sys.stdin), daemon=True).start()


def _steer(playback: "Playback", lines: Iterable[str]) -> None:
    for line in lines:
        key, *rest = line.split() or [""]
        if key == "q":
            playback.stop()
        elif key == "p":
            playback.pause()
        elif key == "j" and len(rest) == 1 and rest[0].replace(".", "", 1).isdecimal():
            playback.jump(float(rest[0]))
        else:
            print(KEYS, flush=True)
