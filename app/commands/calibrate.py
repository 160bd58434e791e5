"""`livedrive calibrate`: ten seconds in which the eyes are told apart from the average."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import tyro

from sensors.types import FPS, NS, Clock, InputError, Packet, Source

if TYPE_CHECKING:
    from encoder.eyes.calibration import Take, Target
    from encoder.eyes.encoder import EyeEncoder

LEAD_S = 2.0  # before the first target, to get ready


@dataclass(kw_only=True)
class Calibrate:
    """Look at five points, blink and close: fits gaze and lids to you; `run` then uses it."""

    eyes: Annotated[tuple[str, ...], tyro.conf.arg(metavar="SPEC ...")] = ()
    """Cameras, as for livedrive run."""
    session: Path | None = None
    """Instead of cameras: a session recorded while following the targets."""
    out: Path | None = None
    """File to write; default: your profile."""

    def run(self) -> None:
        from app.drive.calibration import profile_path
        from encoder.eyes.calibration import fit
        from encoder.eyes.encoder import load_eye_encoder
        from encoder.inference import WEIGHTS
        from sensors.clock import MonotonicClock
        from sensors.live.source import LiveSource
        from sensors.session.recording import Recording
        from sensors.session.replay import ReplaySource

        if bool(self.eyes) == (self.session is not None):
            raise InputError(
                "calibrate: expected either --eyes or --session, got "
                f"{'both' if self.eyes else 'neither'}; try livedrive calibrate --eyes uvc:0"
            )
        encoder, clock = load_eye_encoder(WEIGHTS), MonotonicClock()
        source: Source
        if self.session:
            source = ReplaySource(Recording(self.session), clock, realtime=False, eyes=True)
            takes = collect(source, encoder, clock, print, live=False)
        else:
            from sensors.cameras.spec import cameras

            source = LiveSource(None, cameras(self.eyes, clock), clock)
            takes = collect(source, encoder, clock, print, live=True)
        calibration, refused = fit(takes)
        for words in refused:
            print(f"kept as it is: {words}")
        path = self.out or profile_path()
        calibration.save(path)
        print(f"wrote {path.resolve()}")


def words_of(target: "Target") -> str:
    """What a person is to do."""
    if target.name != "look":
        return {"blink": "blink a few times", "close": "close your eyes"}[target.name]
    if target.yaw_deg:
        return f"look {abs(target.yaw_deg):.0f} degrees {'left' if target.yaw_deg > 0 else 'right'}"
    if target.pitch_deg:
        return (
            f"look {abs(target.pitch_deg):.0f} degrees {'up' if target.pitch_deg > 0 else 'down'}"
        )
    return "look straight ahead"


def collect(
    source: Source,
    encoder: "EyeEncoder",
    clock: Clock,
    tell: Callable[[str], None],
    *,
    live: bool,
) -> "list[Take]":
    """Follow the routine's schedule on the source's own time and encode what is seen."""
    from encoder.eyes.calibration import ROUTINE, Take
    from encoder.eyes.encoder import new_encoder_state
    from sensors.assemble import Assembler

    lead = int(LEAD_S * FPS) if live else 0
    edges = lead + np.cumsum([0, *(int(target.seconds * FPS) for target in ROUTINE)])
    assembler, rows, shown, state = Assembler(), list[Any](), -1, new_encoder_state()
    source.open()
    try:
        while len(rows) < edges[-1] and not source.exhausted:
            packets: list[Packet] = source.poll()
            for packet in packets:
                assembler.push(packet)
            for frame in assembler.ready():
                place = int(np.searchsorted(edges, len(rows), side="right")) - 1
                if place != shown and 0 <= place < len(ROUTINE):
                    shown = place
                    tell(words_of(ROUTINE[place]))
                reading = None
                if frame.eyes is not None:
                    reading, state = encoder.step(frame.eyes, state)
                rows.append((reading, frame.eyes_valid))
            if live and not packets:
                clock.sleep_until_ns(clock.now_ns() + NS // 200)
    finally:
        source.close()
    if len(rows) < edges[-1]:
        raise InputError(
            f"calibrate: expected {edges[-1] / FPS:.0f} s of eyes, got {len(rows) / FPS:.1f} s; "
            "record the whole routine"
        )
    return [
        Take(target, *_arrays(rows[start:stop]))
        for target, start, stop in zip(ROUTINE, edges[:-1], edges[1:], strict=True)
    ]


def _arrays(rows: list[Any]) -> tuple[Any, Any, Any, Any]:
    """(reading or None, fresh [2]) of each frame -> gaze and relative gaze [T, 2, 3], lids [T, 2],
    good [T, 2]."""
    gaze, relative = np.zeros((2, len(rows), 2, 3), np.float32)
    lids, good = np.zeros((len(rows), 2), np.float32), np.zeros((len(rows), 2), np.bool_)
    for t, (reading, fresh) in enumerate(rows):
        if reading is not None:
            gaze[t], relative[t], lids[t] = reading.told(fresh), reading.relative, reading.lids
            good[t] = fresh & (reading.score > 0.5)
    return gaze, relative, lids, good
