"""Mouth details that a face tracker misses, added to its curves by the rules.

Between the importers of tracked motion and the data set. A tracker's blendshapes lose closures
between two of its pictures, and know neither the lower lip on the teeth nor the tongue. The phones
tell all three; how far the lips are apart and how wide they are stays the tracker's: the rules'
widths differ from a talker's own.
"""

import numpy as np

from encoder.capture.motion import closures, rules
from encoder.capture.motion.channels import MOUTH_CLOSE
from encoder.capture.motion.contacts import LipGeometry
from encoder.capture.motion.shift import best_shift
from encoder.capture.motion.style import Style
from encoder.capture.speech.phones import LIP_CLOSING, TEETH_TOUCHING, Phone

SYNC_R = 0.4  # of tracked and rule-made opening, below which labels do not follow their sound
SYNC_FRAMES = 4  # that they may be early or late


def opening(rig: np.ndarray) -> np.ndarray:
    """[..., 53] -> [...] how far the lips are apart, in units of mouthClose."""
    return closures.closing_weight(rig) - rig[..., MOUTH_CLOSE]


def in_sync(curves: np.ndarray, phones: list[Phone], style: Style) -> bool:
    """Do the lips of [T, 53] do what the phones ask, and when they ask it?"""
    times = rules.frame_times(len(curves))
    level = np.ones(len(times), np.float32)
    speaking = rules.speaking_at(phones, times)
    made = rules.open_mouth(rules.gesture_tracks(phones, times, style), level, speaking, style)
    close, _ = _contacts(phones, times)
    asked = (opening(made) * (1 - close)).astype(np.float64)
    r, shift = best_shift(opening(curves).astype(np.float64), asked, 2 * SYNC_FRAMES)
    return r >= SYNC_R and abs(shift) <= SYNC_FRAMES


def _contacts(phones: list[Phone], times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """[T] 0..1 lips shut, [T] 0..1 lower lip on teeth."""
    meet = closures.holds(phones, LIP_CLOSING, times, np.zeros(len(times), bool))
    shut = (times >= meet[:, :1]) & (times <= meet[:, 1:])
    on_teeth = closures.holds(phones, TEETH_TOUCHING, times, np.asarray(shut.any(0)))
    every = np.concatenate([meet, on_teeth])
    return closures.contact(meet, every, times), closures.contact(on_teeth, every, times)


def tongue(phones: list[Phone], num_frames: int, style: Style) -> np.ndarray:
    """[T, 3] 0..1, in the order of TONGUE_NAMES: as the rules move it, as no tracker sees it."""
    times = rules.frame_times(num_frames)
    tracks = rules.gesture_tracks(phones, times, style)
    return rules.tongue_curves(tracks, rules.speaking_at(phones, times))


def articulated(
    curves: np.ndarray,  # [T, 53]
    phones: list[Phone],
    style: Style,
    lips: LipGeometry | None,
) -> np.ndarray:
    """[T, 53] with closures of p b m and the tuck of f v as the phones ask."""
    close, touch = _contacts(phones, rules.frame_times(len(curves)))
    return np.clip(closures.with_contacts(curves.copy(), close, touch, style, lips), 0, 1)
