"""Calibration of a person's eyes: a small map of each eye's gaze and of its lid.

The map is affine, and near the places where the wearer was seen to look at a target it is moved by
what it was still off there: how a picture tells gaze differs from wearer to wearer by more than an
affine map, most of all straight ahead, where eyes are most of the time.

Fitted in ten seconds (`encoder/eyes/routine.py`), kept in the user's profile and in the session.
Applied between EyeEncoder and EyeTracker; the identity changes nothing.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from encoder.eyes.format import unit, within
from sensors import files
from sensors.types import InputError

Array = NDArray[np.float32]
Points = tuple[tuple[tuple[float, float], ...], ...]
FORMAT = 3  # 1 had no relative gaze, 2 no places
MAX_SHIFT = 0.35  # 20 degrees
MAX_PLACES, LARGEST = 32, 100.0  # of places; of any number in a file
NEAR = 0.06  # 3.4 degrees: how far from a place its move counts


@dataclass(frozen=True)
class EyeCalibration:
    """Of each eye: xy' = matrix xy + shift, and near `places` their moves; lid' = (lid - shut) /
    (open - shut).

    A fitted eye maps its relative gaze, the others the encoder's guess of the absolute one.
    """

    matrix: tuple[tuple[tuple[float, float], tuple[float, float]], ...] = (
        ((1.0, 0.0), (0.0, 1.0)),
    ) * 2
    shift: tuple[tuple[float, float], ...] = ((0.0, 0.0),) * 2
    shut: tuple[float, float] = (0.0, 0.0)
    open: tuple[float, float] = (1.0, 1.0)
    relative: tuple[bool, bool] = (False, False)
    places: Points = (((0.0, 0.0),),) * 2  # [2, n, 2] as read; as many of either eye
    moves: Points = (((0.0, 0.0),),) * 2  # [2, n, 2] 0: none
    _arrays: tuple[Array, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        values = (self.matrix, self.shift, self.shut, self.open, self.relative)
        values = (*values, self.places, self.moves)
        arrays = tuple(np.asarray(value, np.float32) for value in values)
        object.__setattr__(self, "_arrays", arrays)

    def apply(self, gaze: Array, relative: Array, lids: Array) -> tuple[Array, Array]:
        """gaze and relative gaze [2, 3], lids [2] of an EyeReading -> gaze, lids of this person."""
        matrix, shift, shut, wide, fitted, places, moves = self._arrays
        seen = np.where(fitted[:, None] > 0, relative[:, :2], gaze[:, :2])
        xy = (matrix @ seen[..., None])[..., 0] + shift
        if any(self.relative):
            xy += (nearness(seen[:, None], places) @ moves)[:, 0]
        return unit(xy), within((lids - shut) / (wide - shut), 0, 1).astype(np.float32)

    def recentred(self, gaze: Array) -> EyeCalibration:
        """The same, but what `apply` made `gaze` [2, 3] is now straight ahead."""
        middle = gaze.mean(0)[:2]  # both eyes: how far they converge stays
        shift = np.clip(self._arrays[1] - middle, -MAX_SHIFT, MAX_SHIFT)
        return replace(self, shift=as_tuples(shift))

    def to_json(self) -> dict[str, Any]:
        names = ("matrix", "shift", "shut", "open", "relative", "places", "moves")
        return {"format": FORMAT, **{name: getattr(self, name) for name in names}}

    @staticmethod
    def from_json(
        words: Mapping[str, Any], where: str, cure: str = "run `livedrive calibrate` again"
    ) -> EyeCalibration:
        """Checked in shape and size; InputError of one line otherwise."""
        shapes = {"matrix": (2, 2, 2), "shift": (2, 2), "shut": (2,), "open": (2,)}
        shapes["relative"] = (2,)
        try:
            places = np.asarray(words["places"], np.float64)
            shapes |= dict.fromkeys(("places", "moves"), (2, min(len(places[0]), MAX_PLACES), 2))
            arrays = {name: np.asarray(words[name], np.float64) for name in shapes}
            good = words.get("format") == FORMAT and all(
                arrays[name].shape == shape and np.abs(arrays[name]).max() <= LARGEST
                for name, shape in shapes.items()
            )
        except (KeyError, TypeError, ValueError, OverflowError, IndexError):
            good, arrays = False, {}
        # as it is applied: a lid that opens by less than 32 bits tell would be no number
        if not good or (np.subtract(arrays["open"], arrays["shut"], dtype=np.float32) <= 0).any():
            raise InputError(
                f"eye calibration {where}: expected format {FORMAT} with {', '.join(shapes)}, got "
                f"another; {cure}"
            )
        fitted = arrays.pop("relative") > 0
        values = {name: as_tuples(array) for name, array in arrays.items()}
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


def nearness(
    xy: NDArray[Any],  # [..., m, 2]
    places: NDArray[Any],  # [..., n, 2]
) -> NDArray[Any]:  # [..., m, n]
    """0..1: how near each is to each place, in what is read of gaze."""
    away = xy[..., :, None, :] - places[..., None, :, :]
    return np.exp(-0.5 * (away * away).sum(-1) / NEAR**2)


def as_tuples(array: NDArray[Any]) -> Any:
    return tuple(as_tuples(row) if row.ndim else float(row) for row in array)
