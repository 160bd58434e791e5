"""ARKit blendshapes: the 52 named channels, and the table that Live Link Face writes."""

import csv
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.sinks.sink import FrameResult, RunInfo
from render import arkit as shapes
from render.decoder import Decoder
from sensors.types import FPS, InputError

_EYE = ("Blink", "LookDown", "LookIn", "LookOut", "LookUp", "Squint", "Wide")
# Apple's names in the column order of Live Link Face.
ARKIT_NAMES = (
    *(f"eye{part}Left" for part in _EYE),
    *(f"eye{part}Right" for part in _EYE),
    *("jawForward", "jawRight", "jawLeft", "jawOpen"),
    *("mouthClose", "mouthFunnel", "mouthPucker", "mouthRight", "mouthLeft"),
    *("mouthSmileLeft", "mouthSmileRight", "mouthFrownLeft", "mouthFrownRight"),
    *("mouthDimpleLeft", "mouthDimpleRight", "mouthStretchLeft", "mouthStretchRight"),
    *("mouthRollLower", "mouthRollUpper", "mouthShrugLower", "mouthShrugUpper"),
    *("mouthPressLeft", "mouthPressRight", "mouthLowerDownLeft", "mouthLowerDownRight"),
    *("mouthUpperUpLeft", "mouthUpperUpRight", "browDownLeft", "browDownRight", "browInnerUp"),
    *("browOuterUpLeft", "browOuterUpRight", "cheekPuff", "cheekSquintLeft", "cheekSquintRight"),
    *("noseSneerLeft", "noseSneerRight", "tongueOut"),
)
FULL_YAW_DEG, FULL_PITCH_DEG = 30.0, 25.0  # gaze at which an eyeLook channel reaches 1
_COLUMNS = [shapes.NAMES.index(name) for name in ARKIT_NAMES]
_ANGLES = ("Yaw", "Pitch", "Roll")
_EXTRA = [f"{part}{angle}" for part in ("Head", "LeftEye", "RightEye") for angle in _ANGLES]


def gaze_angles(gaze: NDArray[np.float32]) -> NDArray[np.float32]:
    """Unit vectors [..., 3] -> yaw (towards the subject's left) and pitch (up) [..., 2], rad."""
    yaw = np.arctan2(gaze[..., 0], gaze[..., 2])
    return np.stack([yaw, np.arcsin(np.clip(gaze[..., 1], -1, 1))], -1)


def arkit(
    rig: NDArray[np.float32],  # [T, 53] activations
    gaze: NDArray[np.float32],  # [T, 2, 3] unit, left first
    rig_names: list[str],
) -> NDArray[np.float32]:  # [T, 52] 0..1, in the order of ARKIT_NAMES
    """Named blendshapes; the eyeLook channels follow the gaze, the tongue is never out."""
    out = shapes.from_rig(rig, rig_names)[:, _COLUMNS]
    angles = np.degrees(gaze_angles(gaze)) / [FULL_YAW_DEG, FULL_PITCH_DEG]
    for eye, (side, outward) in enumerate((("Left", 1), ("Right", -1))):
        yaw, up = outward * angles[:, eye, 0], angles[:, eye, 1]
        for part, value in {"In": -yaw, "Out": yaw, "Up": up, "Down": -up}.items():
            out[:, ARKIT_NAMES.index(f"eyeLook{part}{side}")] = value
    return out.clip(0, 1)


class ArkitSink:
    """A CSV like Live Link Face's: timecode, count, 52 blendshapes, head and eye angles (rad)."""

    def __init__(self, path: Path, decoder: Decoder) -> None:
        if not path.parent.is_dir():
            raise InputError(f"--arkit: expected a folder {path.parent}, got none; create it first")
        self._path, self._decoder = path, decoder

    def on_start(self, info: RunInfo) -> None:
        self._file = self._path.open("w", newline="")
        self._rows = csv.writer(self._file)
        pascal = [name[0].upper() + name[1:] for name in ARKIT_NAMES]
        self._rows.writerow(["Timecode", "BlendShapeCount", *pascal, *_EXTRA])

    def on_frame(self, result: FrameResult) -> None:
        driven = result.driven
        rig = self._decoder.rig(driven.expression[None])
        values = arkit(rig, driven.gaze[None], self._decoder.rig_names)[0]
        angles = gaze_angles(driven.gaze)
        eyes = [x for yaw, pitch in angles for x in (yaw, pitch, 0.0)]
        cells = [f"{value:.10f}" for value in (*values, 0.0, 0.0, 0.0, *eyes)]
        self._rows.writerow([timecode(driven.index), len(cells), *cells])

    def close(self) -> None:
        self._file.close()


def timecode(index: int) -> str:
    """hh:mm:ss:ff.000 of a frame, as Live Link Face writes it."""
    seconds, frame = divmod(index, FPS)
    minutes, second = divmod(seconds, 60)
    hour, minute = divmod(minutes, 60)
    return f"{hour:02d}:{minute:02d}:{second:02d}:{frame:02d}.000"
