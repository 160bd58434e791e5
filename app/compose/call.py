"""A call beside a live run: its process, its microphone, and everybody at one table."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from app.call.live.gate import Gate
from app.call.live.link import CallLink, CallMicrophone, CallSink
from app.call.live.protocol import CallSettings
from app.compose.live import tell
from app.compose.settings import SoundSettings
from app.drive.loop import Drive
from app.drive.sink import FrameResult, RunInfo
from encoder.types import DrivenFrame
from sensors.types import SAMPLES_PER_FRAME, InputError

if TYPE_CHECKING:
    from app.call.trial.material import Material
    from sensors.live.source import LiveSource


def open_call(settings: CallSettings) -> CallLink:
    return CallLink(settings, tell)


def through_call(
    source: "LiveSource", link: CallLink, sound: SoundSettings, speaker: str | None
) -> None:
    """Let the source's microphone pass through the call."""
    from app.call.live.echo import EchoCanceller

    if source.microphone is None:
        return
    echo, noise = sound.is_on(sound.echo, speaker), sound.is_on(sound.noise, speaker)
    cleaner = EchoCanceller(echo, noise) if echo or noise else None
    source.microphone = CallMicrophone(source.microphone, link, cleaner)


def with_call(parts: Drive, link: CallLink) -> Drive:
    """The parts of a live run, with the call as one more sink; what is muted does not reach
    the driver."""
    source = Gate(parts.source, link)
    return replace(parts, source=source, sinks=[*parts.sinks, CallSink(link, tell)])


class _Collect:
    """Keeps a session's sound and what the driver made of it; not the eyes' pictures, which would
    fill the memory."""

    def __init__(self) -> None:
        self.sound: list[NDArray[np.float32]] = []
        self.driven: list[DrivenFrame] = []

    def on_start(self, info: RunInfo) -> None: ...
    def on_frame(self, result: FrameResult) -> None:
        self.sound.append(result.sensors.audio)
        self.driven.append(result.driven)

    def close(self) -> None: ...


def session_material(session: Path) -> "Material":
    """Sound and codes of a recorded session, for `call test`."""
    from app.call.trial.material import Material
    from app.call.wire.packet import basis_of
    from app.compose.replay import replay
    from app.compose.settings import DriveSettings
    from render.decoder.decoder import Decoder

    collect, settings = _Collect(), DriveSettings()
    replay(session, settings, [collect])
    count = len(collect.driven)
    if count < 60:
        raise InputError(f"call test: expected a session of 2 s or more, got {count} frames")
    decoder = Decoder.load(gaussians=settings.gaussians)  # the same
    basis = basis_of(decoder.coding.frame, decoder.coding.to_code)
    sound = np.concatenate(collect.sound)
    assert len(sound) == SAMPLES_PER_FRAME * count
    return Material(
        sound=sound,
        expression=np.array([d.expression for d in collect.driven]),
        gaze=np.array([d.gaze for d in collect.driven]),
        rows=basis.rows,
        reach=basis.reach,
        lips=decoder.moves(decoder.regions["lips"]),
    )


def trial_report(material: "Material", lines: Sequence[int], seconds: float) -> dict[str, Any]:
    """Both ends on this machine over each of the `lines`."""
    from app.call.trial.relay import LINES
    from app.call.trial.runner import metrics_of, note_of, run_line

    report: dict[str, Any] = {"metrics": {}, "bars": [], "notes": []}
    for number in lines:
        found = run_line(LINES[number], material, seconds, seed=number)
        metrics, bars = metrics_of(LINES[number], found)
        report["metrics"] |= metrics
        report["bars"] += bars
        report["notes"].append(note_of(LINES[number], found))
    return report
