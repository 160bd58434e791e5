"""The calibration routine: a person follows its targets while the cameras are encoded."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from sensors.cameras.reasons import LIST
from sensors.types import FPS, NS, Clock, InputError, Packet, Source

if TYPE_CHECKING:
    from encoder.eyes.encoder import EyeEncoder
    from encoder.eyes.routine import EyeFit, RoutineStep, TargetSamples

LEAD_S = 2.0  # before the first target, to get ready
CAMERAS_S = 10.0  # that cameras may take to open


def words_of_fit(eye: "EyeFit") -> str:
    """One line: how good it is, and what was left as it was."""
    line = f"{eye.name + ' eye':10s} {eye.grade:14s}"
    if eye.off_deg is not None and eye.before_deg is not None:
        line += f"{eye.off_deg:5.1f} degrees off the targets ({eye.before_deg:.1f} without)"
    left = [f"gaze as it was: {eye.gaze}"] if eye.gaze else []
    left += [f"lids as they were: {eye.lid}"] if eye.lid else []
    return "; ".join([line, *left])


def words_of(target: "RoutineStep") -> str:
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
    show: "Callable[[RoutineStep], None]",
    *,
    live: bool,
    problems: Callable[[], str] = str,
) -> "list[TargetSamples]":
    """Follow the routine's schedule on the source's own time and encode what is seen; `show` gets
    each target as its time begins. A live routine begins with the first pictures; `problems`: why
    a camera has none. Raises InputError where it has none for too long."""
    from encoder.eyes.encoder import new_encoder_state
    from encoder.eyes.routine import ROUTINE, TargetSamples
    from sensors.assemble import Assembler

    lead = int(LEAD_S * FPS) if live else 0
    edges = lead + np.cumsum([0, *(int(target.seconds * FPS) for target in ROUTINE)])
    assembler, rows, shown, state = Assembler(), list[Any](), -1, new_encoder_state()
    seen, waited = not live, 0
    source.open()
    try:
        while len(rows) < edges[-1] and not source.exhausted:
            packets: list[Packet] = source.poll()
            for packet in packets:
                assembler.push(packet)
            for frame in assembler.ready():
                if not seen and (problems() or frame.eyes is None):
                    waited += 1
                    if waited > CAMERAS_S * FPS:
                        why = problems() or "no camera sends"
                        raise InputError(
                            f"calibrate: expected pictures of the eyes, got none: {why}"
                            + ("" if "; see: " in why else f"; see: {LIST}")
                        )
                    continue
                seen = True
                place = int(np.searchsorted(edges, len(rows), side="right")) - 1
                if place != shown and 0 <= place < len(ROUTINE):
                    shown = place
                    show(ROUTINE[place])
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
        TargetSamples(target, *_arrays(rows[start:stop]))
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
