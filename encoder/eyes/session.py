"""Automatic calibration during a session: the range of the lids and the resting gaze.

So that without calibration the head is right for eyes that are narrow, droopy or seen from an odd
place. Everything moves slowly and by less and less, so nothing that is shown ever jumps.

Where: EyeReading -> SessionState -> EyeCalibration -> EyeTracker, unless the person has made one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from encoder.eyes.calibration import EyeCalibration

Array = NDArray[np.float32]
LID_PRIOR, LID_MEMORY = 60.0, 1800.0  # frames of the usual opening: prior 2 s, memory 1 min
NARROWEST = 0.45  # usual opening, as read, that is taken for an eye that is open
OWN_DROOP = 0.12  # of opening: droop of a person's lids that is not corrected
AMID_BLINK = 0.6  # of the usual opening; below, a lid is on its way
BLINK_PRIOR, BLINK_MEMORY = 2.0, 12.0  # blinks after which the shut lid counts as known
MOST_SHUT = 0.25  # opening, as read, that may stand for a shut eye
GAZE_PRIOR, MEMORY = 900.0, 3600.0  # frames: half a minute, two minutes
USUAL = np.array([[-0.032, -0.06], [0.032, -0.06]], np.float32)  # a little down, at 1 m
MAX_SHIFT = 0.25  # 14 degrees


@dataclass(frozen=True, eq=False)
class SessionState:
    """A value; all as the encoder reads it, left eye first."""

    frames: Array  # [2] in which an open eye was seen
    wide: Array  # [2] usual opening
    blinks: Array  # [2]
    shut: Array  # [2] opening of shut eyes
    lowest: Array  # [2] opening in the blink that is under way; 1: none is
    centre: Array  # [2, 2] x and y of the usual gaze

    def calibration(self) -> EyeCalibration:
        """The calibration learned so far: usual opening = open, usual gaze = straight ahead."""
        wide = np.clip(self.wide + OWN_DROOP, NARROWEST, 1.0)
        shut = np.minimum(self.shut, MOST_SHUT * wide)
        known = (self.frames / (self.frames + GAZE_PRIOR))[:, None]
        shift = np.clip(known * (USUAL - self.centre), -MAX_SHIFT, MAX_SHIFT)
        (lx, ly), (rx, ry) = shift.tolist()
        (ls, rs), (lw, rw) = shut.tolist(), wide.tolist()
        return EyeCalibration(shift=((lx, ly), (rx, ry)), shut=(ls, rs), open=(lw, rw))


def new_session() -> SessionState:
    zeros, ones = np.zeros(2, np.float32), np.ones(2, np.float32)
    return SessionState(zeros, ones - np.float32(OWN_DROOP), zeros, zeros, ones, USUAL)


def learned(
    lids: Array,  # [2] opening, as read
    gaze: Array,  # [2, 3] as read
    good: NDArray[np.bool_],  # [2] the eye is seen
    state: SessionState,
) -> SessionState:
    """The state after one more frame."""
    limit = AMID_BLINK * state.wide
    awake = good & (lids > limit)
    frames = np.minimum(state.frames + awake, MEMORY)
    wide = state.wide + awake * (lids - state.wide) / (np.minimum(frames, LID_MEMORY) + LID_PRIOR)
    # a blink is over once the lid is up again: its lowest opening is what shut looks like
    over = awake & (state.lowest < limit)
    blinks = np.minimum(state.blinks + over, BLINK_MEMORY)
    shut = state.shut + over * (state.lowest - state.shut) / (blinks + BLINK_PRIOR)
    lowest = np.where(awake, 1.0, np.where(good, np.minimum(state.lowest, lids), state.lowest))
    centre = state.centre + (awake / (frames + 1))[:, None] * (gaze[:, :2] - state.centre)
    arrays = (frames, wide, blinks, shut, lowest, centre)
    return SessionState(*(array.astype(np.float32) for array in arrays))
