"""Read motion of one's own: Live Link Face CSV takes (iPhone, ARKit's 52 names).

An importer of the capture and of `livedrive session create --livelink`. Bad takes end in one line.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from encoder.capture.motion.channels import RIG_NAMES, TONGUE_NAMES, from_arkit
from sensors import livelink_table
from sensors.types import FPS, InputError

MAX_GAP_S = 0.5  # curves are interpolated over shorter gaps


@dataclass(frozen=True)
class LivelinkTake:
    """ARKit weights as the phone delivered them."""

    times: np.ndarray  # [N] seconds from the first row
    names: list[str]  # ARKit's camelCase names
    weights: np.ndarray  # [N, K] float32 0..1

    def at_frames(self, num_frames: int) -> np.ndarray:
        """[T, K] at 30 FPS; frame k is read at the end of its 1600 samples, ends are held.

        A row tells what was seen until the next one, as a picture of a video does, and as
        `--arkit` writes it: row k of 30 a second is what frame k sees.
        """
        times = (np.arange(num_frames) + 1) / FPS
        seen = self.times + self.times[-1] / (len(self.times) - 1)
        return np.stack([np.interp(times, seen, c) for c in self.weights.T], 1)

    def rig(self, num_frames: int) -> tuple[np.ndarray, np.ndarray]:
        """Curves [T, 53] and tongue [T, 3] at 30 FPS."""
        weights = self.at_frames(num_frames).astype(np.float32)
        tongue = np.zeros((num_frames, len(TONGUE_NAMES)), np.float32)
        tongue[:, 0] = weights[:, self.names.index("tongueOut")]
        return from_arkit(weights, self.names), tongue


def read_livelink(path: Path) -> LivelinkTake:
    """A Live Link Face CSV; raises InputError where it is none, or its time is not even."""
    names = _arkit_names()
    table = livelink_table.read(path, names, livelink_table.WEIGHTS)
    _check_times(path, table)
    return LivelinkTake(table.times, names, np.clip(table.values.astype(np.float32), 0, 1))


def _check_times(path: Path, table: livelink_table.LivelinkTable) -> None:
    if len(table.lines) < 2:
        raise InputError(
            f"{path}: expected at least 2 rows of motion, got {len(table.lines)}; record anew"
        )
    steps = np.diff(table.times)
    if (steps < -1e-6).any():
        number = table.lines[int(np.argmax(steps < -1e-6)) + 1]
        raise InputError(
            f"{path}: line {number}: expected time to rise, it falls; split the take there"
        )
    if steps.max() > MAX_GAP_S:
        number = table.lines[int(steps.argmax()) + 1]
        raise InputError(
            f"{path}: line {number}: expected gaps under {MAX_GAP_S} s, got {steps.max():.2f} s; "
            "split the take there"
        )
    measured = len(steps) / max(table.times[-1], 1e-6)
    if not 20 <= measured <= 65:
        raise InputError(
            f"{path}: expected 24-60 rows a second, got {measured:.1f}; "
            "check the export's frame rate"
        )


def _arkit_names() -> list[str]:
    """ARKit's 52 names, from the rig's."""
    names = []
    for name in RIG_NAMES:
        if name in ("browInnerUp_L", "cheekPuff_L"):
            names.append(name[:-2])
        elif name not in ("browInnerUp_R", "cheekPuff_R"):
            names.append(name.replace("_L", "Left").replace("_R", "Right"))
    return [*names, "tongueOut"]
