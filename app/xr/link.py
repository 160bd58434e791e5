"""The memory that the loop and the headset's process share: ticks one way, poses the other.

    loop -> XrSink -> ticks -> headset's process -> poses -> HeadsetLink -> loop

Nobody ever waits (see app.process.ring).
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from app.process import memory
from app.process.ring import Ring
from render.types import SHARED_DENSITY, Density
from sensors.types import FACE_DIM

Mode = Literal["auto", "headless"]
TICK = np.dtype(
    [
        ("number", "<i8"),  # of posting, 0, 1, ...; -1 while it is written
        ("t_ns", "<i8"),  # of the frame's last sample
        ("posted_ns", "<i8"),  # on the system's monotonic clock, which all processes share
        ("expression", "<f4", (256,)),
        ("gaze", "<f4", (2, 3)),
        ("head", "<f4", (8,)),  # position mm, quaternion wxyz, breath
    ],
    align=True,
)
POSE = np.dtype(
    [
        ("number", "<i8"),
        ("t_ns", "<i8"),
        ("position", "<f8", (3,)),  # m, OpenXR's axes, as all below
        ("xyzw", "<f8", (4,)),
        ("tracked", "?"),
        ("gaze", "<f8", (3,)),  # unit, in the head; NaN: not tracked
        ("face", "<f4", (FACE_DIM,)),  # 0..1; NaN: not tracked
    ],
    align=True,
)
STATUS = np.dtype(
    [
        ("ready", "?"),  # a session is open, or waited for
        ("ending", "?"),  # written by the loop: the run is over
        ("ended", "?"),  # the wearer has ended it
        ("avatar", "S4096"),  # written by the loop: who is drawn, which may be a path
        ("error", "S400"),  # why there will be no session
        ("problem", "S200"),  # why there is none now; empty: there is one
        ("runtime", "S100"),
        ("state", "S16"),  # of the session, as OpenXR names it
        ("width", "<i8"),  # px of an eye's picture
        ("height", "<i8"),
        ("frames", "<i8"),  # in stereo, so far
        ("poses", "<i8"),
        ("losses", "<i8"),  # sessions that were lost
        ("draw_ms", "<f8"),  # of a stereo frame, lately
        ("share", "<f8"),  # of the width and height of a full picture, lately
    ],
    align=True,
)
TICKS, POSES = 16, 64


@dataclass(frozen=True)
class XrInfo:
    """What the headset's process must know; sent to it as JSON."""

    mode: Mode
    avatar: str
    gaussians: Density = SHARED_DENSITY
    background: str = "studio"
    seats: str | None = None  # handle of a call's seats: partners are drawn too
    standin: str | None = None  # a file: while it is there, so is a runtime for tests
    standin_px: tuple[int, int] = (64, 64)  # an eye's picture of that one


class XrMemory:
    """Both rings and the status, on memory that vanishes with its last user."""

    def __init__(self, handle: str | None = None) -> None:
        """Make the memory, or open what another process made."""
        poses_at = TICKS * TICK.itemsize
        status_at = poses_at + POSES * POSE.itemsize
        size = status_at + STATUS.itemsize
        self._block = memory.attach(handle, size) if handle else memory.create(size)
        self.handle, buffer = self._block.handle, self._block.buffer
        ticks = np.frombuffer(buffer, TICK, TICKS)
        poses = np.frombuffer(buffer, POSE, POSES, poses_at)
        self.status: np.void = np.frombuffer(buffer, STATUS, 1, status_at)[0]
        if handle is None:
            ticks["number"] = poses["number"] = -1
        self.ticks, self.poses = Ring(ticks), Ring(poses)

    def text(self, field: str) -> str:
        """A text of the status."""
        return bytes(self.status[field]).decode(errors="replace")

    def close(self) -> None:
        """Let go of the memory; it vanishes when the arrays do."""
        self._block.close()
