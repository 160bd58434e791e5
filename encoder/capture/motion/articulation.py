"""Mouth details that a face tracker misses, added to its curves by the rules.

Between the importers of tracked motion and the data set. A tracker's blendshapes hardly know how
wide the lips are (GRID's main talker: 1.1 mm of deviation where lips' landmarks have 3.3, and none
of it follows s, i or w), lose closures between two of its pictures, and do not know the lower lip
on the teeth. The phones tell all three; how far the lips are apart stays the tracker's.
"""

import numpy as np

from encoder.capture.motion import closures, rules
from encoder.capture.motion.channels import JAW_OPEN, MOUTH_CLOSE, RIG_INDEX, RIG_NAMES
from encoder.capture.motion.contacts import LipGeometry
from encoder.capture.motion.shift import best_shift
from encoder.capture.motion.style import Style
from encoder.capture.speech.phones import LIP_CLOSING, TEETH_TOUCHING, Phone

_WIDTH = [
    RIG_INDEX[name]
    for name in (
        "mouthStretch_L", "mouthStretch_R", "mouthDimple_L", "mouthDimple_R", "mouthPucker",
        "mouthFunnel",
    )
]  # fmt: skip
_JAW = closures.closing_weight(np.eye(len(RIG_NAMES))[JAW_OPEN])  # that an open jaw opens the lips
BY_RULES = 0.5  # of the width that the rules ask for beyond the tracked one: they err differently
SYNC_R = 0.4  # of tracked and rule-made opening, below which labels do not follow their sound
SYNC_FRAMES = 4  # that they may be early or late


def opening(rig: np.ndarray) -> np.ndarray:
    """[..., 53] -> [...] how far the lips are apart, in units of mouthClose."""
    return closures.closing_weight(rig) - rig[..., MOUTH_CLOSE]


def in_sync(curves: np.ndarray, phones: list[Phone], style: Style) -> bool:
    """Do the lips of [T, 53] do what the phones ask, and when they ask it?"""
    times = rules.frame_times(len(curves))
    made, close, _ = _asked(phones, times, style)
    asked = (opening(made) * (1 - close)).astype(np.float64)
    r, shift = best_shift(opening(curves).astype(np.float64), asked, 2 * SYNC_FRAMES)
    return r >= SYNC_R and abs(shift) <= SYNC_FRAMES


def _asked(
    phones: list[Phone], times: np.ndarray, style: Style
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """[T, 53] of a mouth without contacts, [T] 0..1 lips shut, [T] 0..1 lower lip on teeth."""
    level = np.ones(len(times), np.float32)
    speaking = rules.speaking_at(phones, times)
    made = rules.open_mouth(rules.gesture_tracks(phones, times, style), level, speaking, style)
    meet = closures.holds(phones, LIP_CLOSING, times, np.zeros(len(times), bool))
    shut = (times >= meet[:, :1]) & (times <= meet[:, 1:])
    on_teeth = closures.holds(phones, TEETH_TOUCHING, times, np.asarray(shut.any(0)))
    every = np.concatenate([meet, on_teeth])
    return made, closures.contact(meet, every, times), closures.contact(on_teeth, every, times)


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
    """[T, 53] with the lips' width, closures of p b m and the tuck of f v as the phones ask.

    What wider lips open more, the jaw opens less.
    """
    made, close, touch = _asked(phones, rules.frame_times(len(curves)), style)
    result = curves.copy()
    result[:, _WIDTH] += BY_RULES * np.maximum(made[:, _WIDTH] - curves[:, _WIDTH], 0)
    more = closures.closing_weight(result) - closures.closing_weight(curves)
    result[:, JAW_OPEN] = np.maximum(result[:, JAW_OPEN] - more / _JAW, 0)
    return np.clip(closures.with_contacts(result, close, touch, style, lips), 0, 1)
