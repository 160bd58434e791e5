"""What a run did: the content of `--report`, and the lines at its end."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

from app.compose.settings import DriveSettings
from app.drive.loop import Drive, Summary
from app.drive.sink import Expendable
from sensors import files
from sensors.types import FPS, SAMPLE_RATE

if TYPE_CHECKING:
    from sensors.live.source import LiveSource


@runtime_checkable
class NetworkSink(Protocol):
    """A sink that counts what it sent."""

    def network_report(self) -> dict[str, Any]: ...


@runtime_checkable
class HeadsetSink(Protocol):
    """A sink that shows the head in a headset."""

    def xr_report(self) -> dict[str, Any]: ...


def report(settings: DriveSettings, parts: Drive, summary: Summary) -> dict[str, Any]:
    """Counts, names and the time of each stage."""
    from encoder.inference import STUDENTS

    condition = parts.driver.config.condition
    network = [sink for sink in parts.sinks if isinstance(sink, NetworkSink)]
    counts: dict[str, Any] = {}
    for sink in network:
        counts |= sink.network_report()
    headset = next((s.xr_report() for s in parts.sinks if isinstance(s, HeadsetSink)), None)
    sinks = [sink for sink in parts.sinks if isinstance(sink, Expendable)]
    lost = [str(sink.path) for sink in sinks if sink.lost]
    return {
        "frames": summary.frames,
        "dropped": summary.dropped,
        "seconds": summary.frames / FPS,
        "late_ms": round(summary.late_ns / 1e6, 3),
        "renderer": parts.view.renderer_name if parts.view else "none",
        "device": settings.device,
        "backend": parts.driver.backend.name,
        "seed": settings.seed or 0,
        "condition": condition,
        "checkpoint": STUDENTS[condition],
        "avatar": settings.avatar,
        "gaussians": parts.gaussians,
        "emotion": parts.emotion,
        "stages": parts.stages.summary(),
        **({"lost": lost} if lost else {}),  # outputs that a full disk has ended
        **({"network": counts} if network else {}),
        **({"xr": headset} if headset else {}),
    }


def sensor_report(source: "LiveSource") -> dict[str, Any]:
    """What each sensor of a live run did."""
    found: dict[str, Any] = {"silence_seconds": round(source.silence_samples / SAMPLE_RATE, 3)}
    microphone = source.microphone
    if microphone is not None:
        found["microphone"] = {
            "name": microphone.info.devices["audio"],
            "problem": microphone.problem,
            "drift_ppm": round(microphone.drift_ppm, 3),
            "lost_samples": microphone.dropped,
            "losses": microphone.losses,
            "reopened": microphone.reopened,
        }
    for camera in source.cameras:
        found[camera.name] = {
            "problem": camera.problem,
            "pictures": camera.counts.pictures,
            "damaged": camera.counts.damaged,
            "unused": camera.counts.unused,
            "connects": camera.counts.connects,
            "delay_ms": round(camera.delay_ns / 1e6, 2),  # of the newest, arrival to checked views
        }
    if source.head is not None:
        counts = asdict(source.head.counts)
        found["head"] = {"name": source.head.name, "problem": source.head.problem, **counts}
    return found


def finish(values: dict[str, Any], path: Path | None, written: Sequence[Path]) -> None:
    """Write the report to `path`, where there is one, and print what was done."""
    if path:
        files.write_text(path, json.dumps(values, indent=2) + "\n")
    tick = values["stages"]["tick"]
    print(
        f"{values['frames']} frames ({values['seconds']:.1f} s), {values['dropped']} dropped, "
        f"tick p50 {tick['p50_ms']:.1f} ms, p99 {tick['p99_ms']:.1f} ms, "
        f"{values['renderer']}, {values['backend']}"
    )
    whole = [made for made in written if str(made) not in values.get("lost", ())]
    for made in (*whole, *([path] if path else [])):
        print(f"wrote {made.resolve()}")
