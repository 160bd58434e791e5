"""ArkitSink: the table that Live Link Face writes."""

import csv
from pathlib import Path

from app.drive.sink import FrameResult, RunInfo
from app.face.arkit import ARKIT_NAMES, arkit
from app.sinks.protocols.livelink import eye_angles
from render.decoder.decoder import Decoder
from sensors import files
from sensors.head import livelink
from sensors.types import FPS

_ANGLES = ("Yaw", "Pitch", "Roll")
_EXTRA = [f"{part}{angle}" for part in ("Head", "LeftEye", "RightEye") for angle in _ANGLES]


class ArkitSink:
    """A CSV like Live Link Face's: timecode, count, 52 blendshapes, head and eye angles (rad)."""

    def __init__(self, path: Path, decoder: Decoder) -> None:
        self._path, self._decoder = path, decoder

    def on_start(self, info: RunInfo) -> None:
        self._file = files.create(self._path, private=True).open("w", newline="")
        self._rows = csv.writer(self._file)
        pascal = [name[0].upper() + name[1:] for name in ARKIT_NAMES]
        self._rows.writerow(["Timecode", "BlendShapeCount", *pascal, *_EXTRA])

    def on_frame(self, result: FrameResult) -> None:
        driven = result.driven
        rig = self._decoder.rig(driven.expression[None])
        values = arkit(rig, driven.gaze[None], self._decoder.rig_names)[0]
        eyes = [x for yaw, pitch in eye_angles(driven.gaze) for x in (yaw, pitch, 0.0)]
        head = livelink.angles(driven.head)
        cells = [f"{value:.10f}" for value in (*values, *head, *eyes)]
        self._rows.writerow([timecode(driven.index), len(cells), *cells])

    def close(self) -> None:
        self._file.close()


def timecode(index: int) -> str:
    """hh:mm:ss:ff.000 of a frame, as Live Link Face writes it."""
    seconds, frame = divmod(index, FPS)
    minutes, second = divmod(seconds, 60)
    hour, minute = divmod(minutes, 60)
    return f"{hour:02d}:{minute:02d}:{second:02d}:{frame:02d}.000"
