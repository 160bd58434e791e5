"""Live Link Face packets, as Epic's phone app sends them to Unreal Engine (UDP, version 6).

The 61 values come in the order of Unreal's EARFaceBlendShape, which has jawLeft before jawRight and
mouthLeft before mouthRight; the app's CSV has them the other way round.
"""

import struct
from uuid import NAMESPACE_URL, uuid5

import numpy as np
from numpy.typing import NDArray

from app.face.arkit import ARKIT_NAMES, gaze_angles
from app.sinks.protocols.face import NamedFace
from sensors.head.livelink import HEAD, angles
from sensors.types import FPS

SUBJECT = "livedrive"
VERSION = 6
SWAPPED = {"jawRight": "jawLeft", "mouthRight": "mouthLeft"}
_SWAPS = SWAPPED | {b: a for a, b in SWAPPED.items()}
PACKET_NAMES = tuple(_SWAPS.get(name, name) for name in ARKIT_NAMES)


def eye_angles(gaze: NDArray[np.float32]) -> NDArray[np.float32]:
    """Unit vectors [2, 3] -> yaw and pitch [2, 2] of the eyes as the app gives them, rad: to the
    subject's right, as EyeLookIn of the left eye grows, and down."""
    return -gaze_angles(gaze)


class LiveLinkEncoder:
    """Faces as packets of one subject."""

    def __init__(self, subject: str = SUBJECT) -> None:
        device = str(uuid5(NAMESPACE_URL, f"livelink:{subject}")).upper().encode()
        name = subject.encode()
        self._head = struct.pack(
            f">Bi{len(device)}si{len(name)}s", VERSION, len(device), device, len(name), name
        )
        self._order = [ARKIT_NAMES.index(name) for name in PACKET_NAMES]

    def __call__(self, face: NamedFace) -> list[bytes]:
        # Timecode: frame, share of a frame, frames a second as a fraction.
        time = struct.pack(">ifii", face.index & 0x7FFFFFFF, 0.0, FPS, 1)
        values = np.zeros(61, ">f4")
        values[:52] = face.arkit[self._order]
        values[HEAD] = angles(face.head)
        values[55:57], values[58:60] = eye_angles(face.gaze)  # rolls are zero
        return [self._head + time + struct.pack(">B", len(values)) + values.tobytes()]
