"""The routine of ten seconds that a calibration is fitted from, and the fit.

A fit is refused where it does not make things better, and where the eyes did not follow the
targets: each target is told from a fit to the others, and has to come out where it was. So
calibration never breaks anything; what is refused stays as it was.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from encoder.eyes.calibration import MAX_SHIFT, EyeCalibration, as_tuples, nearness
from sensors.types import EYE_NAMES, FPS

Array = NDArray[np.float32]
Points = NDArray[np.float64]  # [n, 2]
SETTLE = FPS // 2  # frames that eyes take to arrive at a new target; not used
MIN_FRAMES = 8  # good ones at a target
MIN_TARGETS = 4  # that are looked at, of five
RIDGE = 0.02  # pulls the map to the identity; gaze of 11 degrees has a square of 0.04
NOISE = 0.5  # of what the map is off by at a target, the share that another look would not find
MAX_CHANGE = 1.0  # of the map's matrix from the identity: some eyes' turns are read by half
MAX_CROSSED = 0.5  # of one direction in the other
MAX_OFF_DEG = 6.0  # of targets 10 to 15 degrees away, where eyes that follow are 1 to 3 off
MIN_LID_RANGE = 0.3  # of openings between shut and open
GOOD_DEG, FAIR_DEG = 2.0, 3.5  # off the targets


class GazeMap(NamedTuple):
    """EyeCalibration's map of one eye: an affine one, moved near the places seen."""

    matrix: NDArray[np.float64]  # [2, 2]
    shift: NDArray[np.float64]  # [2]
    places: Points
    moves: Points

    def affine(self, x: Points) -> Points:
        return x @ self.matrix.T + self.shift

    def __call__(self, x: Points) -> Points:
        return self.affine(x) + nearness(x, self.places) @ self.moves


@dataclass(frozen=True)
class RoutineStep:
    """One step of the routine."""

    name: str  # "look", "blink" or "close"
    yaw_deg: float = 0.0  # towards the subject's left
    pitch_deg: float = 0.0
    seconds: float = 1.4

    @property
    def direction(self) -> Array:  # [3]
        yaw, pitch = np.radians([self.yaw_deg, self.pitch_deg])
        return np.array(
            [np.sin(yaw) * np.cos(pitch), np.sin(pitch), np.cos(yaw) * np.cos(pitch)], np.float32
        )


ROUTINE = (
    RoutineStep("look"),
    RoutineStep("look", yaw_deg=15),
    RoutineStep("look", yaw_deg=-15),
    RoutineStep("look", pitch_deg=10),
    RoutineStep("look", pitch_deg=-12),
    RoutineStep("blink", seconds=1.4),
    RoutineStep("close", seconds=1.6),
)


@dataclass(frozen=True, eq=False)
class TargetSamples:
    """What the eye encoder said while one target was shown, from the first frame on."""

    target: RoutineStep
    gaze: Array  # [T, 2, 3]
    relative: Array  # [T, 2, 3]
    lids: Array  # [T, 2]
    good: NDArray[np.bool_]  # [T, 2] the eye was seen


@dataclass(frozen=True, kw_only=True)
class EyeFit:
    """Result of the fit for one eye."""

    name: str
    seen: float  # share of the frames in which it is seen
    before_deg: float | None = None  # mean distance from the targets, as the encoder guesses
    after_deg: float | None = None  # ... of each target, as a fit to the others has it
    gaze: str = ""  # why its gaze is left as it was; empty: fitted
    lid: str = ""

    @property
    def followed(self) -> bool:
        """True if the eye followed the targets."""
        off = [deg for deg in (self.before_deg, self.after_deg) if deg is not None]
        return bool(off) and min(off) <= MAX_OFF_DEG

    @property
    def off_deg(self) -> float | None:
        """Mean distance from the targets with this calibration, degrees."""
        return self.before_deg if self.gaze else self.after_deg

    @property
    def grade(self) -> str:
        off = self.off_deg
        if off is None or not self.followed:
            return "not seen" if self.seen < 0.5 else "did not follow"
        return "good" if off <= GOOD_DEG else "fair" if off <= FAIR_DEG else "poor"


def fit(takes: Sequence[TargetSamples]) -> tuple[EyeCalibration, tuple[EyeFit, EyeFit]]:
    """Takes of a routine -> calibration, and how good it is for each eye."""
    matrix, shift, shut, wide, *_ = ([*value] for value in EyeCalibration()._arrays)
    relative, fits = [False, False], list[EyeFit]()
    places, moves = np.zeros((2, 2, sum(take.target.name == "look" for take in takes), 2))
    for eye, name in enumerate(EYE_NAMES):
        frames = [take.good[:, eye] for take in takes]
        seen = float(np.concatenate(frames).mean()) if frames else 0.0
        found, before, after, why = _fit_gaze(takes, eye)
        if found:
            matrix[eye], shift[eye] = (part.astype(np.float32) for part in found[:2])
            places[eye, : len(found.places)], moves[eye, : len(found.moves)] = found[2:]
            relative[eye] = True
        lid = _fit_lid(takes, eye)
        if lid:
            shut[eye], wide[eye] = lid
        no_lid = "" if lid else "shut and open could not be told apart"
        fits.append(
            EyeFit(name=name, seen=seen, before_deg=before, after_deg=after, gaze=why, lid=no_lid)
        )
    values = (as_tuples(np.asarray(value)) for value in (matrix, shift, shut, wide))
    calibration = EyeCalibration(*values, relative=(relative[0], relative[1]))
    if any(relative):
        calibration = replace(calibration, places=as_tuples(places), moves=as_tuples(moves))
    return calibration, (fits[0], fits[1])


def _fit_gaze(
    takes: Sequence[TargetSamples], eye: int
) -> tuple[GazeMap | None, float | None, float | None, str]:
    """The map, if it is better and moderate; degrees off without and with it; why there is none."""
    seen, guessed, wanted = [], [], []
    for take in takes:
        good = take.good[SETTLE:, eye]
        if take.target.name == "look" and good.sum() >= MIN_FRAMES:
            seen.append(np.median(take.relative[SETTLE:, eye, :2][good], 0))
            guessed.append(np.median(take.gaze[SETTLE:, eye, :2][good], 0))
            wanted.append(take.target.direction[:2])
    if len(seen) < MIN_TARGETS:
        return None, None, None, f"seen at {len(seen)} of 5 targets only"
    x, y = np.array(seen, np.float64), np.array(wanted, np.float64)
    found = _fitted(x, y)
    others = [_fitted(np.delete(x, k, 0), np.delete(y, k, 0)) for k in range(len(x))]
    told = np.concatenate([others[k](x[k : k + 1]) for k in range(len(x))])
    before, inside, after = (_off_deg(y, z) for z in (guessed, found.affine(x), told))
    change = np.abs(found.matrix - np.eye(2))
    plain = change.max() <= MAX_CHANGE and max(change[0, 1], change[1, 0]) <= MAX_CROSSED
    if min(before, after) > MAX_OFF_DEG:
        return None, before, after, "did not follow the targets"
    if inside >= before:
        return None, before, after, "no better than without"
    if not plain or after > MAX_OFF_DEG or np.abs(found.shift).max() > MAX_SHIFT:
        return None, before, after, "no map that fits the targets"
    return found, before, after, ""


def _fitted(x: Points, y: Points) -> GazeMap:
    """Ridge regression, and a Gaussian process on what it leaves."""
    middle = x.mean(0)
    away = x - middle
    change = np.linalg.solve(away.T @ away + RIDGE * np.eye(2), away.T @ (y - x)).T
    matrix = np.eye(2) + change
    shift = y.mean(0) - matrix @ middle
    left = y - x @ matrix.T - shift
    moves = np.linalg.solve(nearness(x, x) + NOISE**2 * np.eye(len(x)), left)
    return GazeMap(matrix, shift, x, moves)


def _off_deg(wanted: NDArray[np.float64], got: Sequence[NDArray[Any]] | NDArray[Any]) -> float:
    return float(np.degrees(np.linalg.norm(wanted - np.array(got), axis=1).mean()))


def _fit_lid(takes: Sequence[TargetSamples], eye: int) -> tuple[float, float] | None:
    """Median opening at the targets, and the lower openings while closed."""
    opened = [t.lids[SETTLE:, eye][t.good[SETTLE:, eye]] for t in takes if t.target.name == "look"]
    closed = [t.lids[SETTLE:, eye][t.good[SETTLE:, eye]] for t in takes if t.target.name == "close"]
    if not opened or not closed:
        return None
    up, down = np.concatenate(opened), np.concatenate(closed)
    if min(len(up), len(down)) < MIN_FRAMES:
        return None
    wide, shut = float(np.median(up)), float(np.quantile(down, 0.3))
    return (shut, wide) if wide - shut >= MIN_LID_RANGE else None
