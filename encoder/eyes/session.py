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
from encoder.eyes.format import within
from sensors.types import FPS

Array = NDArray[np.float32]
LID_PRIOR, LID_MEMORY = 60.0, 1800.0  # frames of the usual opening: prior 2 s, memory 1 min
NARROWEST = 0.45  # usual opening, as read, that is taken for an eye that is open
OWN_DROOP = 0.12  # of opening: droop of a person's lids that is not corrected
AMID_BLINK = 0.6  # of the usual opening; below, a lid is on its way
BLINK_PRIOR, BLINK_MEMORY = 2.0, 12.0  # blinks after which the shut lid counts as known
MOST_SHUT = 0.25  # opening, as read, that may stand for a shut eye
GAZE_PRIOR, MEMORY = 900.0, 3600.0  # looks, one a frame: half a minute, two minutes
# Off the usual gaze, 2 degrees: a look farther aside counts as one of these, so that what was not
# seen for a second is .07 degrees at most of what is shown afterwards.
ASIDE = 0.035
SETTLING = 15.0  # frames in which what was learned comes into use
BRIEF = FPS  # frames in which an eye is not seen to look, and is taken to go on
USUAL = np.array([[-0.032, -0.06], [0.032, -0.06]], np.float32)  # a little down, at 1 m
MAX_SHIFT = 0.25  # 14 degrees


@dataclass(frozen=True, eq=False)
class SessionState:
    """A value; all as the encoder reads it, left eye first."""

    frames: Array  # [2] in which an open eye was seen
    unseen: Array  # [2] frames since
    looks: Array  # [2] frames that the usual gaze is of, with those of blinks and brief losses
    wide: Array  # [2] usual opening
    blinks: Array  # [2]
    shut: Array  # [2] opening of shut eyes
    lowest: Array  # [2] opening in the blink that is under way; 1: none is
    centre: Array  # [2, 2] x and y of the usual gaze
    shift: Array  # [2, 2] that brings it where gaze usually is

    def calibration(self) -> EyeCalibration:
        """The calibration learned so far: usual opening = open, usual gaze = straight ahead."""
        wide = within(self.wide + OWN_DROOP, NARROWEST, 1.0)
        shut = np.minimum(self.shut, MOST_SHUT * wide)
        (lx, ly), (rx, ry) = self.shift.tolist()
        (ls, rs), (lw, rw) = shut.tolist(), wide.tolist()
        return EyeCalibration(shift=((lx, ly), (rx, ry)), shut=(ls, rs), open=(lw, rw))


def new_session() -> SessionState:
    zeros, ones = np.zeros(2, np.float32), np.ones(2, np.float32)
    never = ones * (BRIEF + 1)
    wide = ones - np.float32(OWN_DROOP)
    return SessionState(zeros, never, zeros, wide, zeros, zeros, ones, USUAL, 0 * USUAL)


def learned(
    lids: Array,  # [2] opening, as read
    gaze: Array,  # [2, 3] as read
    good: NDArray[np.bool_],  # [2] the eye is seen
    state: SessionState,
) -> SessionState:
    """The state after one more frame. For a moment, an eye that is shut or not seen is taken to
    look along with the other one, and both as usual: a loss changes little of what is learned.
    """
    limit = AMID_BLINK * state.wide
    awake = good & (lids > limit)
    frames = np.minimum(state.frames + awake, MEMORY)
    wide = state.wide + awake * (lids - state.wide) / (np.minimum(frames, LID_MEMORY) + LID_PRIOR)
    # a blink is over once the lid is up again: its lowest opening is what shut looks like
    over = awake & (state.lowest < limit)
    blinks = np.minimum(state.blinks + over, BLINK_MEMORY)
    shut = state.shut + over * (state.lowest - state.shut) / (blinks + BLINK_PRIOR)
    lowest = np.where(awake, 1.0, np.where(good, np.minimum(state.lowest, lids), state.lowest))
    unseen = np.where(awake, 0, np.minimum(state.unseen + 1, BRIEF + 1))
    counts = unseen <= BRIEF
    looks = np.minimum(state.looks + counts, MEMORY)
    seen = awake[:, None] * within(gaze[:, :2] - state.centre, -ASIDE, ASIDE)
    aside = np.where(awake[:, None], seen, seen[::-1])
    centre = state.centre + (counts / (looks + 1))[:, None] * aside
    known = (looks / (looks + GAZE_PRIOR))[:, None]
    wanted = within(known * (USUAL - centre), -MAX_SHIFT, MAX_SHIFT)
    shift = state.shift + (wanted - state.shift) / SETTLING
    arrays = (frames, unseen, looks, wide, blinks, shut, lowest, centre, shift)
    return SessionState(*(array.astype(np.float32) for array in arrays))
