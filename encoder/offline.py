"""A whole clip through the live path, as fast as it goes: for evaluation, benches and tests."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from encoder.types import Floats
from sensors.types import FPS, NS, SAMPLES_PER_FRAME, SensorFrame

if TYPE_CHECKING:
    from encoder.driver import Driver


class DrivenClip(NamedTuple):
    expression: Floats  # [T, 256] codes, not standardised
    gaze: Floats  # [T, 2, 3] unit vectors, left eye first


def sound_frames(
    sound: Floats,  # [T * 1600] at 48 kHz, or [T, 1600]
    emotion: str | Sequence[str] = "",  # the words at every frame, or at each
) -> Iterator[SensorFrame]:
    """The frames of a session without eye cameras."""
    blind, never = np.zeros(2, np.bool_), np.full(2, -1, np.int64)
    for index, samples in enumerate(sound.reshape(-1, SAMPLES_PER_FRAME)):
        words = emotion if isinstance(emotion, str) else emotion[index]
        t_ns = (index + 1) * NS // FPS
        yield SensorFrame(index, t_ns, samples, None, blind, never, audio_gap=False, emotion=words)


def drive_clip(driver: Driver, frames: Iterable[SensorFrame], seed: int) -> DrivenClip:
    """Step through all frames of a clip from a new state."""
    state, codes, gaze = driver.init_state(seed), list[Floats](), list[Floats]()
    for frame in frames:
        driven, state = driver.step(frame, state)
        codes.append(driven.expression)
        gaze.append(driven.gaze)
    return DrivenClip(np.array(codes), np.array(gaze))
