"""Calibration of a person's eyes: a small affine map of each eye's gaze and of its lid.

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

from encoder.eyes.format import unit
from sensors import files
from sensors.types import InputError

Array = NDArray[np.float32]
FORMAT = 2  # 1 had no relative gaze
MAX_SHIFT = 0.35  # 20 degrees


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
        return replace(self, shift=as_tuples(shift))

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
        except (KeyError, TypeError, ValueError, OverflowError):
            good, arrays = False, {}
        if not good or (arrays["open"] - arrays["shut"]).min() <= 0:
            raise InputError(
                f"eye calibration {where}: expected format {FORMAT} with {', '.join(shapes)}, got "
                "another; run `livedrive calibrate` again"
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


def as_tuples(array: NDArray[Any]) -> Any:
    return tuple(as_tuples(row) if row.ndim else float(row) for row in array)
