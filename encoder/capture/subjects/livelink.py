"""Read motion of one's own: Live Link Face CSV takes (iPhone, ARKit's 52 names).

An importer of the capture and of `livedrive session create --livelink`. Bad takes end in one line.
"""

import csv
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from encoder.capture.motion.channels import RIG_NAMES, TONGUE_NAMES, from_arkit
from sensors.types import FPS, InputError

MAX_GAP_S = 0.5  # curves are interpolated over shorter gaps
_RATES = (24.0, 25.0, 30.0, 60.0)
_TIMECODE = re.compile(r"^(\d+):(\d+):(\d+)[:;](\d+)(?:\.(\d+))?$")


@dataclass(frozen=True)
class LivelinkTake:
    """ARKit weights as the phone delivered them."""

    times: np.ndarray  # [N] seconds from the first row
    names: list[str]  # ARKit's camelCase names
    weights: np.ndarray  # [N, K] float32 0..1

    def at_frames(self, num_frames: int) -> np.ndarray:
        """[T, K] at 30 FPS; frame k is read at the end of its 1600 samples, ends are held."""
        times = (np.arange(num_frames) + 1) / FPS
        return np.stack([np.interp(times, self.times, c) for c in self.weights.T], 1)

    def rig(self, num_frames: int) -> tuple[np.ndarray, np.ndarray]:
        """Curves [T, 53] and tongue [T, 3] at 30 FPS."""
        weights = self.at_frames(num_frames).astype(np.float32)
        tongue = np.zeros((num_frames, len(TONGUE_NAMES)), np.float32)
        if "tongueOut" in self.names:
            tongue[:, 0] = weights[:, self.names.index("tongueOut")]
        return from_arkit(weights, self.names), tongue


def read_livelink(path: Path) -> LivelinkTake:
    """A Live Link Face CSV: Timecode, BlendShapeCount, then PascalCase columns."""
    path = Path(path)
    with path.open(newline="", encoding="utf-8-sig", errors="replace") as file:
        rows = [row for row in csv.reader(file) if row]
    header = rows[0] if rows else []
    if "Timecode" not in header or "JawOpen" not in header:
        raise InputError(
            f"{path}: expected a Live Link Face CSV with the columns Timecode and JawOpen, "
            f"got {', '.join(header[:4])[:60] or 'an empty file'}; export the take as CSV again"
        )
    wanted = {_pascal(name) for name in _arkit_names()}
    columns = [k for k, name in enumerate(header) if name in wanted]
    missing = sorted(wanted - {header[k] for k in columns} - {"TongueOut"})
    if missing:
        raise InputError(
            f"{path}: expected all of ARKit's blendshape columns, missing "
            f"{', '.join(missing[:5])}{' and more' if len(missing) > 5 else ''}; "
            "record the take in ARKit mode and export it again"
        )
    times, weights = [], []
    for number, row in enumerate(rows[1:], 2):
        try:
            weights.append([_weight(row[k]) for k in columns])
            times.append(_parse_timecode(row[header.index("Timecode")]))
        except (ValueError, IndexError) as error:
            got = f"{len(row)} columns" if isinstance(error, IndexError) else repr(str(error))
            raise InputError(
                f"{path}: line {number}: expected a timecode and {len(columns)} weights of 0-1, "
                f"got {got}; repair or delete that line"
            ) from None
    values = np.clip(np.array(weights, np.float32), 0, 1)
    names = [_camel(header[k]) for k in columns]
    return LivelinkTake(_checked_times(path, np.array(times)), names, values)


def _checked_times(path: Path, frames: np.ndarray) -> np.ndarray:
    """Timecodes [N, 2] (second, frame in it) -> seconds; raise on a bad rate or gaps."""
    if len(frames) < 2:
        raise InputError(
            f"{path}: expected at least 2 rows of motion, got {len(frames)}; record anew"
        )
    rate = _rate(path, frames[:, 1])
    times = frames[:, 0] + frames[:, 1] / rate
    steps = np.diff(times)
    if (steps < -1e-6).any():
        number = int(np.argmax(steps < -1e-6)) + 3
        raise InputError(
            f"{path}: line {number}: expected time to rise, it falls; split the take there"
        )
    if steps.max() > MAX_GAP_S:
        number = int(steps.argmax()) + 3
        raise InputError(
            f"{path}: line {number}: expected gaps under {MAX_GAP_S} s, got {steps.max():.2f} s; "
            "split the take there"
        )
    measured = (len(times) - 1) / max(times[-1] - times[0], 1e-6)
    if not 20 <= measured <= 65:
        raise InputError(
            f"{path}: expected 24-60 rows a second, got {measured:.1f}; "
            "check the export's frame rate"
        )
    return times - times[0]


def _rate(path: Path, frames: np.ndarray) -> float:
    """The timecode's frames a second, from the highest frame number seen."""
    highest = int(frames.max())
    if highest >= max(_RATES):
        raise InputError(
            f"{path}: expected timecodes of 24-60 frames a second, got frame number {highest}; "
            "check the export's frame rate"
        )
    # what lasts less than a second may not reach its last number: then the phone's own rates
    rates = _RATES if len(frames) > 60 else (30.0, 60.0)
    return min(rate for rate in rates if rate > highest)


def _weight(text: str) -> float:
    """A weight; ValueError where it is none. Trackers overshoot 0..1 a little."""
    try:
        value = float(text)
    except ValueError:
        raise ValueError(text) from None
    if not -0.5 <= value <= 1.5:
        raise ValueError(text)
    return value


def _parse_timecode(text: str) -> tuple[float, float]:
    match = _TIMECODE.match(text.strip())
    if match is None:
        raise ValueError(text)
    hours, minutes, seconds, frame, part = match.groups()
    whole = 3600.0 * int(hours) + 60 * int(minutes) + int(seconds)
    return whole, int(frame) + float(f"0.{part}" if part else 0)


def _pascal(name: str) -> str:
    return name[0].upper() + name[1:]


def _camel(name: str) -> str:
    return name[0].lower() + name[1:]


def _arkit_names() -> list[str]:
    """ARKit's 52 names, from the rig's."""
    names = []
    for name in RIG_NAMES:
        if name in ("browInnerUp_L", "cheekPuff_L"):
            names.append(name[:-2])
        elif name not in ("browInnerUp_R", "cheekPuff_R"):
            names.append(name.replace("_L", "Left").replace("_R", "Right"))
    return [*names, "tongueOut"]
