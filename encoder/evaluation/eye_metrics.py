"""Metrics of eyes: gaze error, blinks as events and their latency; used by `livedrive eval eyes`.

Pure functions of arrays: nothing here knows networks, files or pictures.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from encoder.evaluation.metrics import runs

Values = NDArray[np.floating]
SHUT = 0.5  # of the usual opening; below it the lid counts as shut
CLOSED = 0.3  # of the usual opening; below it the eye is fully closed (PERCLOS: 70 %)
NEAR_FRAMES = 2  # matching blinks may begin this far apart


class Blinks(NamedTuple):
    """Blinks found, missed and false, and how late the found ones are."""

    hits: int
    missed: int
    false: int
    latencies: list[int]  # frames from each true onset to the one found; > 0 is late

    @property
    def f1(self) -> float:
        total = 2 * self.hits + self.missed + self.false
        return 2 * self.hits / total if total else 1.0

    @property
    def precision(self) -> float:
        return self.hits / (self.hits + self.false) if self.hits + self.false else 1.0

    @property
    def recall(self) -> float:
        return self.hits / (self.hits + self.missed) if self.hits + self.missed else 1.0

    @property
    def on_time(self) -> float:
        """Share of true blinks whose onset was found within one frame."""
        total = self.hits + self.missed
        return sum(abs(late) <= 1 for late in self.latencies) / total if total else 1.0

    def __add__(self, other: object) -> Blinks:
        assert isinstance(other, Blinks)
        return Blinks(*(a + b for a, b in zip(self, other, strict=True)))  # type: ignore[operator]


NO_BLINKS = Blinks(0, 0, 0, [])


def angle_deg(actual: Values, expected: Values) -> NDArray[np.float64]:
    """Unit vectors [..., 3] -> degrees between them [...]."""
    chord = np.linalg.norm(actual.astype(np.float64) - expected, axis=-1)
    return np.degrees(2 * np.arcsin(np.clip(chord / 2, 0, 1)))


def shut_frames(lids: Values) -> NDArray[np.bool_]:  # [T] -> [T]
    """Frames in which the lid is below half of this eye's usual opening."""
    return lids < SHUT * np.median(lids)


def closing_frames(lids: Values) -> NDArray[np.bool_]:  # [T] -> [T]
    """Shut frames of blinks that fully close the eye, without half blinks."""
    shut, closed = shut_frames(lids), lids < CLOSED * np.median(lids)
    for start, stop in runs(shut):
        shut[start:stop] &= closed[start:stop].any()
    return shut


def compare_blinks(found: NDArray[np.bool_], there: NDArray[np.bool_]) -> Blinks:
    """Shut frames [T] -> blinks; a found one matches a true one that it overlaps, or nearly."""
    left, latencies = runs(found), list[int]()
    missed = 0
    for start, stop in runs(there):
        near = [r for r in left if r[0] < stop + NEAR_FRAMES and r[1] > start - NEAR_FRAMES]
        if not near:
            missed += 1
            continue
        best = min(near, key=lambda run: abs(run[0] - start))
        left.remove(best)
        latencies.append(best[0] - start)
    return Blinks(len(latencies), missed, len(left), latencies)
