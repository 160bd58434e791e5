"""Alive: the last step of the Driver; adds head motion, brows, gaze shifts and breath.

    SensorFrame, expression, gaze -> Alive.step -> expression, gaze, head, breath -> DrivenFrame

The head is tracked or follows speech; brows, lids and breath are added to the expression; gaze that
is synthesised jumps in its small way and holds its aim while the head moves (the vestibulo-ocular
reflex), gaze that was measured stays as it is. Everything is causal and a function of the seed and
the frames so far. Not in the paper, which leaves head pose to future work.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, pi, radians, sin
from typing import Literal, NamedTuple

import numpy as np

from encoder.alive import face, motion, noise, prosody, tracking
from encoder.alive.face import FaceState, Shapes
from encoder.alive.motion import MotionState
from encoder.alive.prosody import ProsodyState
from encoder.alive.tracking import TrackState
from encoder.types import Floats
from sensors import rotation
from sensors.rotation import REST, UNIT, Quat
from sensors.types import HeadPose, SensorFrame

Mode = Literal["auto", "synth", "track"]
MICRO_FRAMES = 20  # Martinez-Conde, Macknik and Hubel (2004): micro-saccades, one or two a second
MICRO_RAD = (radians(0.12), radians(0.26))  # of a fixation's offset; jumps of .2 to .5 degrees
KIND = 40  # of noise


@dataclass(frozen=True, eq=False)
class AliveState:
    """State between frames, a value."""

    prosody: ProsodyState
    motion: MotionState = MotionState()
    face: FaceState = FaceState()
    track: TrackState = TrackState()


@dataclass(frozen=True, eq=False)
class AliveFrame:
    """One frame of it."""

    expression: Floats  # [256]
    gaze: Floats  # [2, 3] unit vectors, in the head
    head: HeadPose
    breath: float  # 0..1


class Moved(NamedTuple):
    """What of a frame is known before its expression."""

    brows: float  # 0..1 how far they are up
    lungs: float  # 0..1
    head: HeadPose
    unaided: Quat  # where no tracker says how it is held
    fast: Quat  # of its motion, that eyes make up for
    after: AliveState


class Alive:
    """Holds settings only; every stream's memory is in its state."""

    def __init__(self, shapes: Shapes, mode: Mode = "auto") -> None:
        """auto: the tracker where there is one, else motion from speech; synth: that alone; track:
        the tracker alone, and rest without it."""
        self.shapes, self.mode = shapes, mode

    def init_state(self) -> AliveState:
        return AliveState(prosody.init_state())

    def recentred(self, state: AliveState) -> AliveState:
        return AliveState(state.prosody, state.motion, state.face, tracking.recentred(state.track))

    def move(self, frame: SensorFrame, gaze: Floats | None, seed: int, state: AliveState) -> Moved:
        """The part of `step` that need not wait for the expression; gaze [2, 3] where it is
        synthesised: gaze that was measured moves no head."""
        heard, prosody_state = prosody.step(frame.audio, state.prosody)
        brows, lungs, face_state = face.step(frame.index, heard, seed, state.face)
        wanted = None if gaze is None or self.mode == "track" else _pitch_yaw(gaze)
        a, b, motion_state = motion.step(frame.index, heard, wanted, seed, state.motion)
        moved = rotation.from_angles((a[0] + b[0], a[1] + b[1], a[2] + b[2]))
        head = REST if self.mode == "track" else HeadPose(quat=moved)
        fast, track = UNIT, state.track
        if self.mode != "synth":
            head, fast, track = tracking.step(frame, head, state.track)
        after = AliveState(prosody_state, motion_state, face_state, track)
        return Moved(brows, lungs, head, moved, fast, after)

    def step(
        self,
        frame: SensorFrame,
        expression: Floats,  # [256]
        gaze: Floats,  # [2, 3] unit vectors
        synthesised: bool,  # the gaze
        seed: int,
        state: AliveState,
        moved: Moved | None = None,  # what `move` said of this frame; None: nobody asked
    ) -> tuple[AliveFrame, AliveState]:
        moved = moved or self.move(frame, gaze if synthesised else None, seed, state)
        track, up = moved.after.track, 0.0
        if synthesised:
            quick = moved.fast if track.share > 0 else UNIT
            if self.mode != "track":
                quick = rotation.slerp(moved.unaided, moved.fast, track.share)
            turned = _in_head(gaze, quick) + _micro(seed, frame.index)
            turned /= np.linalg.norm(turned, axis=1, keepdims=True)
            up = float(np.arcsin(turned[:, 1]).mean() - np.arcsin(gaze[:, 1]).mean())
            gaze = turned.astype(np.float32)
        shown = face.changed(expression, self.shapes, moved.brows, moved.lungs, up)
        return AliveFrame(shown, gaze, moved.head, moved.lungs), moved.after


def _pitch_yaw(gaze: Floats) -> tuple[float, float]:
    """[2, 3] -> rad, of both eyes together: down, to the subject's left."""
    x, y, z = gaze.mean(0).tolist()
    return float(-np.arctan2(y, np.hypot(x, z))), float(np.arctan2(x, z))


def _in_head(gaze: Floats, head: Quat) -> Floats:
    """Directions [2, 3] in the room -> in a head that has turned."""
    back = rotation.inverse(head)
    rows = [rotation.rotate(back, (x, y, z)) for x, y, z in gaze.astype(float).tolist()]
    return np.array(rows, np.float32)


def _micro(seed: int, frame: int) -> Floats:  # [3]
    """Where a fixation has moved to since the last micro-saccade; small."""
    slot, into = divmod(frame, MICRO_FRAMES)
    starts, angle, size = noise.uniform(seed, KIND, slot, 3)
    if into < (0.5 + 0.4 * starts) * MICRO_FRAMES:
        _, angle, size = noise.uniform(seed, KIND, slot - 1, 3) if slot else (0.0, 0.0, -1.0)
    low, high = MICRO_RAD
    length = low + (high - low) * (size + 1) / 2
    return np.array([length * cos(pi * angle), 0.6 * length * sin(pi * angle), 0.0], np.float32)
