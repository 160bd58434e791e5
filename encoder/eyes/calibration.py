"""What is personal in the eyes: a small affine map of each eye's gaze and of its lid.

Fitted in ten seconds (look at five points, blink, close), kept in the user's profile and in the
session. A fit that does not make things better is refused, so calibration never breaks anything:
the identity always remains. Applied between EyeEncoder and EyeTracker.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from encoder.eyes.format import unit
from sensors import files
from sensors.types import FPS, InputError

Array = NDArray[np.float32]
FORMAT = 2  # 1 had no relative gaze
SETTLE = FPS // 2  # frames that eyes take to arrive at a new target; not used
MIN_FRAMES = 8  # good ones at a target
RIDGE = 0.02  # pulls the map to the identity; gaze of 11 degrees has a square of 0.04
MAX_CHANGE = 1.0  # of the map's matrix from the identity: some eyes' turns are read by half
MAX_SHIFT = 0.35  # 20 degrees
MIN_LID_RANGE = 0.3  # of openings between shut and open


@dataclass(frozen=True)
class Target:
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
    Target("look"),
    Target("look", yaw_deg=15),
    Target("look", yaw_deg=-15),
    Target("look", pitch_deg=10),
    Target("look", pitch_deg=-12),
    Target("blink", seconds=1.4),
    Target("close", seconds=1.6),
)


@dataclass(frozen=True)
class EyeCalibration:
    """xy' = matrix xy + shift of each eye's gaze; lid' = (lid - shut) / (open - shut).

    A fitted eye maps its relative gaze, the others the encoder's guess of the absolute one.
    """

    matrix: tuple[tuple[tuple[float, float], tuple[float, float]], ...] = (
        ((1.0, 0.0), (0.0, 1.0)),
    ) * 2
    shift: tuple[tuple[float, float], ...] = ((0.0, 0.0),) * 2
    shut: tuple[float, float] = (0.0, 0.0)
    open: tuple[float, float] = (1.0, 1.0)
    relative: tuple[bool, bool] = (False, False)
    _arrays: tuple[Array, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        values = (self.matrix, self.shift, self.shut, self.open, self.relative)
        arrays = tuple(np.asarray(value, np.float32) for value in values)
        object.__setattr__(self, "_arrays", arrays)

    def apply(self, gaze: Array, relative: Array, lids: Array) -> tuple[Array, Array]:
        """gaze and relative gaze [2, 3], lids [2] of an EyeReading -> gaze, lids of this person."""
        matrix, shift, shut, wide, fitted = self._arrays
        seen = np.where(fitted[:, None] > 0, relative[:, :2], gaze[:, :2])
        xy = (matrix @ seen[..., None])[..., 0] + shift
        return unit(xy), np.clip((lids - shut) / (wide - shut), 0, 1).astype(np.float32)

    def recentred(self, gaze: Array) -> EyeCalibration:
        """The same, but what `apply` made `gaze` [2, 3] is now straight ahead."""
        middle = gaze.mean(0)[:2]  # both eyes: how far they converge stays
        shift = np.clip(self._arrays[1] - middle, -MAX_SHIFT, MAX_SHIFT)
        return replace(self, shift=_tuples(shift))

    def to_json(self) -> dict[str, Any]:
        names = ("matrix", "shift", "shut", "open", "relative")
        return {"format": FORMAT, **{name: getattr(self, name) for name in names}}

    @staticmethod
    def from_json(words: Mapping[str, Any], where: str) -> EyeCalibration:
        """Checked in shape and size; InputError of one line otherwise."""
        shapes = {"matrix": (2, 2, 2), "shift": (2, 2), "shut": (2,), "open": (2,)}
        shapes["relative"] = (2,)
        try:
            arrays = {name: np.asarray(words[name], np.float64) for name in shapes}
            good = words.get("format") == FORMAT and all(
                arrays[name].shape == shape and np.isfinite(arrays[name]).all()
                for name, shape in shapes.items()
            )
        except (KeyError, TypeError, ValueError):
            good, arrays = False, {}
        if not good or (arrays["open"] - arrays["shut"]).min() <= 0:
            raise InputError(
                f"eye calibration {where}: expected format {FORMAT} with {', '.join(shapes)}, got "
                "another; run `livedrive calibrate` again"
            )
        fitted = arrays.pop("relative") > 0
        values = {name: _tuples(array) for name, array in arrays.items()}
        return EyeCalibration(**values, relative=(bool(fitted[0]), bool(fitted[1])))

    def save(self, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        files.write_text(path, json.dumps(self.to_json(), indent=1) + "\n", private=True)

    @staticmethod
    def load(path: Path) -> EyeCalibration:
        try:
            words = files.read_json(path)
        except (OSError, ValueError) as error:
            raise InputError(
                f"eye calibration {path}: expected a JSON file, got {error}; "
                "run `livedrive calibrate`"
            ) from error
        return EyeCalibration.from_json(words if isinstance(words, dict) else {}, str(path))


def _tuples(array: NDArray[Any]) -> Any:
    return tuple(_tuples(row) if row.ndim else float(row) for row in array)


@dataclass(frozen=True, eq=False)
class Take:
    """What the eye encoder said while one target was shown, from the first frame on."""

    target: Target
    gaze: Array  # [T, 2, 3]
    relative: Array  # [T, 2, 3]
    lids: Array  # [T, 2]
    good: NDArray[np.bool_]  # [T, 2] the eye was seen


def fit(takes: Sequence[Take]) -> tuple[EyeCalibration, list[str]]:
    """Takes of a routine -> calibration, and what was refused and why, in words."""
    refused: list[str] = []
    matrix, shift, shut, wide, _ = ([*value] for value in EyeCalibration()._arrays)
    relative = [False, False]
    for eye, name in enumerate(("left", "right")):
        fitted = _fit_gaze(takes, eye)
        if fitted is None:
            refused.append(f"gaze of the {name} eye: no better than without")
        else:
            matrix[eye], shift[eye] = fitted
            relative[eye] = True
        lid = _fit_lid(takes, eye)
        if lid is None:
            refused.append(f"lid of the {name} eye: shut and open could not be told apart")
        else:
            shut[eye], wide[eye] = lid
    values = (_tuples(np.asarray(value)) for value in (matrix, shift, shut, wide))
    return EyeCalibration(*values, relative=(relative[0], relative[1])), refused


def _fit_gaze(takes: Sequence[Take], eye: int) -> tuple[Array, Array] | None:
    """Ridge regression from the medians at the targets; None unless it is better and moderate."""
    seen, guessed, wanted = [], [], []
    for take in takes:
        good = take.good[SETTLE:, eye]
        if take.target.name == "look" and good.sum() >= MIN_FRAMES:
            seen.append(np.median(take.relative[SETTLE:, eye, :2][good], 0))
            guessed.append(np.median(take.gaze[SETTLE:, eye, :2][good], 0))
            wanted.append(take.target.direction[:2])
    if len(seen) < 3:
        return None
    x, y = np.array(seen, np.float64), np.array(wanted, np.float64)
    middle = x.mean(0)
    away = x - middle
    change = np.linalg.solve(away.T @ away + RIDGE * np.eye(2), away.T @ (y - x)).T
    matrix = np.eye(2) + change
    shift = y.mean(0) - matrix @ middle
    before = np.linalg.norm(y - np.array(guessed), axis=1).mean()
    after = np.linalg.norm(y - (x @ matrix.T + shift), axis=1).mean()
    moderate = np.abs(change).max() <= MAX_CHANGE and np.abs(shift).max() <= MAX_SHIFT
    if not moderate or not after < before:
        return None
    return matrix.astype(np.float32), shift.astype(np.float32)


def _fit_lid(takes: Sequence[Take], eye: int) -> tuple[float, float] | None:
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
