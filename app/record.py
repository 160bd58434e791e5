"""`livedrive record DIR`: the sensors alone, every packet, for later."""

from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from app.live import LiveOptions, ends_on_signals, open_recorder, sensor_report
from sensors.types import NS

POLL_NS = 4_000_000  # fast enough for every picture of a 120 Hz camera
TELL_NS = NS


@dataclass(kw_only=True)
class Record(LiveOptions):
    """Record the microphone and the eye cameras without driving anything."""

    folder: Positional[Path]
    """Folder to create."""

    def run(self) -> None:
        import sys

        from sensors.clock import MonotonicClock
        from sensors.portaudio import silence_native_messages

        clock = MonotonicClock()
        source = self.live_source(clock)
        recorder = open_recorder(self.folder, source)
        silence_native_messages()
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
                    if shows and now_ns - told_ns > TELL_NS:
                        told_ns = now_ns
                        print(f"\r{seconds:6.0f} s  {_states(source)}", end="\033[K", flush=True)
                    clock.sleep_until_ns(now_ns + POLL_NS)
            finally:
                report = sensor_report(source)
                source.close()
                recorder.close()
        if shows:
            print()
        if recorder.problem:
            raise SystemExit(1)
        print(f"recorded {seconds:.1f} s, {report['silence_seconds']:.1f} s of it without sound")
        print(f"wrote {self.folder.resolve()}; next: livedrive replay {self.folder}")
        if signals:
            raise KeyboardInterrupt


def _states(source) -> str:  # type: ignore[no-untyped-def]
    from app.dashboard import meter

    parts: list[str] = []
    if source.microphone:
        microphone = source.microphone
        parts.append(microphone.problem or meter(microphone.level_db))
    for camera in source.cameras:
        parts.append(f"{camera.name}: {camera.problem or 'live'}")
    return "  ".join(parts)
