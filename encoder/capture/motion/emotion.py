"""Emotions as layers over the motion of speech; see encoder/emotion/labels.py.

Layers are added before the contacts of the lips are solved, so none reopens a closure.
"""

import numpy as np

from encoder.capture.motion.channels import RIG_INDEX, RIG_NAMES
from encoder.emotion.labels import EMOTIONS
from sensors.types import FPS


def layer(
    name: str, strength: float, level: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, float]:
    """Loudness [T] -> [T, 53] to add, and the factor of the mouth's motion.

    It swells and ebbs slowly, and rises a little with loudness, as moods do.
    """
    emotion, num_frames = EMOTIONS[name], len(level)
    curves = np.zeros((num_frames, len(RIG_NAMES)), np.float32)
    if not emotion.channels or num_frames == 0:
        return curves, 1.0
    knots = rng.uniform(0.65, 1.0, num_frames // (2 * FPS) + 2)
    wave = np.interp(np.arange(num_frames), np.arange(len(knots)) * 2 * FPS, knots)
    amount = strength * wave * (0.85 + 0.15 * level)
    own = rng.uniform(0.75, 1.25, len(RIG_NAMES))
    for channel, weight in emotion.channels.items():
        sides = _sides(channel)
        shown = (weight * own[sides[0]] * amount).astype(np.float32)
        curves[:, sides] += shown[:, None]
    return curves, 1 + strength * (emotion.mouth - 1)


def _sides(channel: str) -> list[int]:
    """The rig's column of a channel, or those of its left and right side."""
    names = [channel] if channel in RIG_INDEX else [f"{channel}_L", f"{channel}_R"]
    return [RIG_INDEX[name] for name in names]
