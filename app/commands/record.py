"""`livedrive record DIR`: the sensors alone, every packet, for later."""

import shlex
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from tyro.conf import Positional

from app.commands.live import LiveOptions, ends_on_signals
from app.compose.live import live_source, open_poses, open_recorder, tell
from app.compose.settings import LiveSettings
from app.terminal.arguments import optional
from sensors.head import spec as heads
from sensors.types import NS, Clock, InputError

if TYPE_CHECKING:
    from sensors.live.source import LiveSource

POLL_NS = 4_000_000  # fast enough for every picture of a 120 Hz camera
TELL_NS = NS


@dataclass(kw_only=True)
class Record(LiveOptions):
    """Record the microphone and the eye cameras without driving anything."""

    folder: Positional[Path]
    """Folder to create."""
    mic: Annotated[str | None, optional("NAME|none")] = None
    """Microphone: its name or part of it, see livedrive devices; none: silence."""
    head: Annotated[
        str, tyro.conf.arg(metavar="SPEC|still", help=f"Head tracker: {heads.HELP}.")
    ] = "still"
    xr: bool = False
    """Record an OpenXR headset's pose, and gaze and face where it tracks them; it shows nothing."""

    def live_settings(self) -> LiveSettings:
        settings = super().live_settings()
        if not self.xr:
            return settings
        if self.head not in ("still", "xr"):
            raise InputError(f"--xr: expected one tracker, got --head {self.head}, too; give one")
        return replace(settings, head="xr")

    def run(self) -> None:
        from sensors.clock import MonotonicClock

        settings, clock = self.live_settings(), MonotonicClock()
        with open_poses(clock) if self.xr else nullcontext() as xr:
            self._record(live_source(settings, clock, xr=xr), clock)

    def _record(self, source: "LiveSource", clock: Clock) -> None:
        import sys

        from app.compose.report import sensor_report
        from app.sinks.sensor_notes import SensorNotes
        from sensors.audio.portaudio import silence_native_messages

        recorder = open_recorder(self.folder, source, alone=True)
        silence_native_messages()
        notes = SensorNotes(source, tell)
        seconds, shows, told_ns = 0.0, sys.stdout.isatty(), 0
        with ends_on_signals(source) as signals:
            try:
                source.open()
                start_ns = clock.now_ns()
                while not source.exhausted and not recorder.problem:
                    for packet in source.poll():
                        recorder.append(packet)
                    now_ns = clock.now_ns()
                    seconds = (now_ns - start_ns) / NS
                    if not shows:
                        notes.check(now_ns)
                    if shows and now_ns - told_ns > TELL_NS:
                        told_ns = now_ns
                        print(f"\r{seconds:6.0f} s  {_states(source)}", end="\033[K", flush=True)
                    clock.sleep_until_ns(now_ns + POLL_NS)
            finally:
                notes.close()
                report = sensor_report(source)
                source.close()
                recorder.close()
        if shows:
            print()
        if recorder.problem:
            raise SystemExit(1)
        print(f"recorded {seconds:.1f} s, {report['silence_seconds']:.1f} s of it without sound")
        next_words = shlex.join(["livedrive", "replay", str(self.folder)])
        print(f"wrote {self.folder.resolve()}; next: {next_words}")
        if signals:
            raise KeyboardInterrupt


def _states(source: "LiveSource") -> str:
    from app.sinks.dashboard import meter
    from app.terminal.console import one_line
    from sensors.audio.microphone import Microphone

    parts: list[str] = []
    if source.microphone:
        microphone = source.microphone
        level = meter(microphone.level_db) if isinstance(microphone, Microphone) else "live"
        parts.append(microphone.problem or level)
    for camera in source.cameras:
        parts.append(f"{camera.name}: {camera.problem or 'live'}")
    if source.head:
        parts.append(f"{source.head.name}: {source.head.problem or 'live'}")
    return one_line("  ".join(parts))
