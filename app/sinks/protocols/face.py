"""The face as numbers with names: what every protocol and table is filled from.

A gains file adapts the channels to an avatar of another program, in JSON:
`{"jawOpen": {"gain": 1.4, "low": 0.0, "high": 0.9}}`; what it does not name passes unchanged.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.face.arkit import ARKIT_NAMES, arkit, gaze_angles
from encoder.types import DrivenFrame
from render.decoder.decoder import Decoder
from sensors import files
from sensors.types import HeadPose, InputError

LARGEST = 1000.0  # gain or limit
NEUTRAL = {"gain": 1.0, "low": 0.0, "high": 1.0}


@dataclass(frozen=True)
class NamedFace:
    """One tick's face; the left eye comes first."""

    index: int
    t_ns: int
    arkit: NDArray[np.float32]  # [52] 0..1, in the order of ARKIT_NAMES
    gaze: NDArray[np.float32]  # [2, 3] unit vectors
    angles: NDArray[np.float32]  # [2, 2] rad: yaw towards the subject's left, pitch up
    head: HeadPose = HeadPose()  # from its rest


Encoder = Callable[[NamedFace], list[bytes]]  # a face as datagrams


class FaceReader:
    """Names the channels of a driven frame."""

    def __init__(self, decoder: Decoder, gains: Path | None = None) -> None:
        self._decoder = decoder
        self._gain, self._low, self._high = read_gains(gains) if gains else (1.0, 0.0, 1.0)

    def __call__(self, driven: DrivenFrame) -> NamedFace:
        rig = self._decoder.rig(driven.expression[None])
        values = arkit(rig, driven.gaze[None], self._decoder.rig_names)[0] * self._gain
        return NamedFace(
            index=driven.index,
            t_ns=driven.t_ns,
            arkit=np.clip(values, self._low, self._high).astype(np.float32),
            gaze=driven.gaze,
            angles=gaze_angles(driven.gaze),
            head=driven.head,
        )


def read_gains(path: Path) -> tuple[NDArray[np.float32], ...]:
    """A gains file as gain [52], low [52], high [52]; raise InputError where it is wrong."""
    try:
        channels: dict[str, Any] = files.read_json(path)
    except InputError:
        raise
    except ValueError as error:
        raise InputError(f"{path}: expected JSON, got {error}; correct the file") from error
    if not isinstance(channels, dict):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise InputError(
            f"{path}: expected an object of channels, got another value; "
            f"try {json.dumps({'jawOpen': NEUTRAL})}"
        )
    columns = {key: np.full(len(ARKIT_NAMES), value, np.float32) for key, value in NEUTRAL.items()}
    for name, wanted in channels.items():
        if name not in ARKIT_NAMES:
            near = ", ".join(get_close_matches(name, ARKIT_NAMES, 3)) or "jawOpen, ..."
            raise InputError(f"{path}: expected a channel like {near}, got {name!r}; rename it")
        if not isinstance(wanted, dict) or not set(wanted) <= set(NEUTRAL):  # pyright: ignore
            raise InputError(
                f"{path}: {name}: expected an object with gain, low, high, got {wanted!r}; "
                f"try {json.dumps({name: NEUTRAL})}"
            )
        limits: dict[str, Any] = NEUTRAL | wanted
        numbers = all(isinstance(v, int | float) and abs(v) <= LARGEST for v in limits.values())
        if not numbers or limits["low"] > limits["high"]:
            raise InputError(
                f"{path}: {name}: expected numbers up to {LARGEST:g} with low <= high, got "
                f"{str(limits)[:80]}; correct it"
            )
        for key, value in limits.items():
            columns[key][ARKIT_NAMES.index(name)] = value
    return columns["gain"], columns["low"], columns["high"]
