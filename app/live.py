"""What `run` and `record` share: which sensors are opened, how they end, what is told of them."""

import signal
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from sensors.types import Clock, InputError

if TYPE_CHECKING:
    from sensors.live import LiveMicrophone, LiveSource
    from sensors.live_recorder import LiveRecorder


@dataclass(kw_only=True)
class LiveOptions:
    """Options of the commands that listen and look."""

    mic: Annotated[str | None, tyro.conf.arg(metavar="NAME|none|web")] = None
    """Microphone, or a part of its name; none for silence; web for that of the --web page.
    See: livedrive devices."""
    eyes: Annotated[tuple[str, ...], tyro.conf.arg(metavar="SPEC ...")] = ()
    """One camera for both eyes, or left and right: uvc:0, http://host:81/, serial:/dev/ttyACM0,
    usb:35bd:0202, file:eye.mkv, session:DIR; after a #: swap, mirror, turn=90, crop=X:Y:W:H,
    or profile=NAME."""
    seconds: float | None = None
    """End by itself after so much sound."""

    def live_source(self, clock: Clock, microphone: "LiveMicrophone | None" = None) -> "LiveSource":
        """Check the options and build the sensors; they are not opened yet. A `microphone` that is
        given takes the place of the one that `--mic` names."""
        from sensors import portaudio
        from sensors.eyes.spec import cameras
        from sensors.live import LiveSource
        from sensors.microphone import Microphone

        if self.seconds is not None and self.seconds <= 0:
            raise InputError(
                f"--seconds: expected more than 0, got {self.seconds}; try --seconds 10"
            )
        eyes = cameras(self.eyes, clock)
        if microphone is None and self.mic != "none":
            if self.mic is not None:
                portaudio.check_name(self.mic)
            microphone = Microphone(self.mic, clock)
        return LiveSource(microphone, eyes, clock, seconds=self.seconds)


def open_recorder(
    folder: Path, source: "LiveSource", calibration: Mapping[str, Any] | None = None
) -> "LiveRecorder":
    from datetime import UTC, datetime

    from sensors.live_recorder import LiveRecorder

    created = datetime.now(UTC).isoformat(timespec="seconds")
    devices = source.info.devices
    return LiveRecorder(
        folder, created=created, devices=devices, tell=tell, calibration=calibration
    )


def tell(line: str) -> None:
    import sys

    print("livedrive: " + " ".join(line.split()), file=sys.stderr, flush=True)


@contextmanager
def ends_on_signals(source: "LiveSource") -> Iterator[list[int]]:
    """Ctrl-C and `kill` end the source, so that everything is finished; a second one breaks off.

    Yields the list of signals that came.
    """
    came: list[int] = []

    def stop(number: int, _: Any) -> None:
        if came:
            raise KeyboardInterrupt
        came.append(number)
        source.stop()

    before = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield came
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def sensor_report(source: "LiveSource") -> dict[str, Any]:
    """What each sensor did, for --report."""
    report: dict[str, Any] = {"silence_seconds": round(source.silence_samples / 48_000, 3)}
    microphone = source.microphone
    if microphone is not None:
        report["microphone"] = {
            "name": microphone.info.devices["audio"],
            "problem": microphone.problem,
            "drift_ppm": round(microphone.drift_ppm, 3),
            "lost_samples": microphone.dropped,
            "losses": microphone.losses,
            "reopened": microphone.reopened,
        }
    for camera in source.cameras:
        report[camera.name] = {
            "problem": camera.problem,
            "pictures": camera.counts.pictures,
            "damaged": camera.counts.damaged,
            "unused": camera.counts.unused,
            "connects": camera.counts.connects,
            "delay_ms": round(camera.delay_ns / 1e6, 2),  # of the newest, arrival to checked views
        }
    return report
