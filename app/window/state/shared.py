"""The memory that the loop and the window share: ticks one way, controls the other.

    loop -> WindowSink -> ring of ticks -> window process -> controls -> loop

Nobody ever waits (see app.process.ring).
"""

from dataclasses import dataclass

import numpy as np

from app.drive.stages import STAGES
from app.process import memory
from app.process.ring import Ring
from render.types import DENSITY, Density
from sensors.types import EYE_SIZE

SLOTS = 16  # half a second of ticks
TICK = np.dtype(
    [
        ("number", "<i8"),  # of posting, 0, 1, ...; -1 while it is written
        ("index", "<i8"),  # of the frame
        ("t_ns", "<i8"),  # of the frame's last sample
        ("posted_ns", "<i8"),  # on the system's monotonic clock, which all processes share
        ("expression", "<f4", (256,)),
        ("gaze", "<f4", (2, 3)),
        ("head", "<f4", (8,)),  # position mm, quaternion wxyz, breath
        ("level", "<f4", (2,)),  # of the sound: rms, peak; 0..1
        ("audio_gap", "?"),
        ("eyes_valid", "?", (2,)),
        ("eyes_age_ms", "<f4", (2,)),  # -1: there was no picture yet
        ("eyes", "u1", (2, EYE_SIZE, EYE_SIZE)),
        ("eye_frames", "<f4", (2, 5)),  # DrivenFrame's; a width of 0: none
        ("stage_ms", "<f4", (len(STAGES),)),  # of the tick before, in the order of STAGES
        ("dropped", "<i8"),  # ticks stepped and not drawn, so far
    ],
    align=True,
)
CONTROLS = np.dtype(
    [
        ("ready", "?"),  # the window is on the screen
        ("closed", "?"),  # a person has closed it
        ("ending", "?"),  # written by the loop: the run is over
        ("muted", "?"),
        ("recording", "?"),
        ("avatar", "<i8"),  # index into WindowInfo.avatars
        ("emotion", "<i8"),  # index into WindowInfo.emotions; one more: `words`; -1: none
        ("words", "S1024"),  # of an emotion that has no name in the list: a mixture
        ("intensity", "<f4"),  # of the emotion, 0..1
        ("recentred", "<i8"),
        ("resets", "<i8"),
        ("frames", "<i8"),  # pictures shown so far
        ("shown", "<i8"),  # index of the newest frame the window has seen; -1: none
        ("error", "S400"),  # why the window could not open
    ],
    align=True,
)


@dataclass(frozen=True)
class WindowInfo:
    """What the window must know before its first picture."""

    title: str
    avatar: str
    avatars: tuple[str, ...]
    emotions: tuple[str, ...] = ()  # empty: the encoder offers none
    emotion: str = ""  # words of the command line
    can_record: bool = False
    live: bool = False  # a microphone can be muted
    frames: int | None = None  # how many will come, where that is known
    size: int = 512  # px of the head on software GL; a GPU fills the window
    background: str = "studio"
    gaussians: Density = DENSITY
    seats: str | None = None  # handle of a call's seats: partners are drawn too


class SharedMemory:
    """The ring of ticks and the controls."""

    def __init__(self, handle: str | None = None) -> None:
        """Make the memory, or open what another process made."""
        size = SLOTS * TICK.itemsize + CONTROLS.itemsize
        self._block = memory.attach(handle, size) if handle else memory.create(size)
        self.handle, buffer = self._block.handle, self._block.buffer
        ticks = np.frombuffer(buffer, TICK, SLOTS)
        self.controls: np.void = np.frombuffer(buffer, CONTROLS, 1, SLOTS * TICK.itemsize)[0]
        if handle is None:
            ticks["number"] = self.controls["emotion"] = self.controls["shown"] = -1
            self.controls["intensity"] = 1
        self.ticks = Ring(ticks)

    def close(self) -> None:
        """Let go of the memory; it vanishes when the arrays do."""
        self._block.close()
