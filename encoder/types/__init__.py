"""The types that the encoder's rooms share, and what it hands to the decoder.

Flow: SensorFrame -> Driver.step -> DrivenFrame -> Decoder. Nothing here needs a network.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from sensors.types import HeadPose

Floats = NDArray[np.float32]
Doubles = NDArray[np.float64]
Weights = dict[str, NDArray[Any]]  # a network's tensors by their names
Condition = Literal["gaze", "eyes"]  # what the denoiser knows of the eyes


@dataclass(frozen=True, eq=False)
class DrivenFrame:
    """One frame of the head, to be decoded."""

    index: int
    t_ns: int
    expression: Floats  # [256] code, not standardised
    gaze: Floats  # [2, 3] unit vectors, left eye first
    head: HeadPose = HeadPose()  # from its rest; the eyes look in the head's own frame
    breath: float = 0.0  # 0..1, how far it lifts the chest
    # [2, 5] the part of each eye camera's picture that is looked at: its middle's x (right) and y
    # (down) and half its width, all in half widths of the picture, its turn (clockwise, radians),
    # and the chance 0..1 that an eye is there. None without cameras.
    eye_frames: Floats | None = None


@dataclass(frozen=True, eq=False)
class Mood:
    """Where the cross-fade between two emotions is. Mixtures are [labels]; None: not begun."""

    words: str = ""
    start: Floats | None = None
    end: Floats | None = None
    left: int = 0  # frames until `end` is reached


@dataclass(frozen=True, eq=False)
class DriverState:
    """A value: everything the next frame depends on, with the seed of its noise.

    It may be kept and stepped from again, any number of times.
    """

    seed: int
    backend: object  # the backend's own frozen state, e.g. OnnxState
    gaze: object  # WalkState where gaze is synthesised, EyeState with eye cameras
    mood: Mood = Mood()
    alive: object = None  # AliveState where the head is alive
