"""Gaze from nothing: fixations and saccades, when no eye camera says where the eyes look.

Rule-made, not learned: durations, amplitudes and the share of looks at the partner follow published
averages (paper appendix "Gaze Synthesis" uses a graph of recorded gaze instead). Causal, a function
of (seed, frame) only. Where: before the denoiser, as its condition and as the decoder's gaze.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import radians

import numpy as np
from numpy.typing import NDArray

from sensors.types import FPS

EYE_X_MM = 31.95  # half the distance between the eyes; left (index 0) is at +x
PARTNER_SHARE = 0.5  # of fixations that rest on the partner straight ahead
SACCADE_S, SACCADE_S_PER_DEG = 0.025, 0.0024


@dataclass(frozen=True)
class GazeState:
    """Eyes move from `start` to `target` over `saccade` frames, then rest until `end` frames."""

    fixation: int  # how many fixations there were
    frame: int  # frames since this one began
    saccade: float  # frames
    end: int  # frames
    start: tuple[float, float, float]  # yaw, pitch in degrees; distance in mm
    target: tuple[float, float, float]


class GazeSynth:
    """step(state) -> gaze [2, 3] unit vectors (left, right; +x subject's left, +z forward)."""

    def __init__(self, seed: int) -> None:
        self.seed = seed

    def init_state(self) -> GazeState:
        ahead = (0.0, 0.0, 1000.0)
        return GazeState(fixation=0, frame=0, saccade=1.0, end=FPS, start=ahead, target=ahead)

    def step(self, state: GazeState) -> tuple[NDArray[np.float32], GazeState]:
        if state.frame >= state.end:
            state = self._next_fixation(state)
        progress = min((state.frame + 1) / state.saccade, 1.0)
        eased = progress**3 * (10 - 15 * progress + 6 * progress**2)  # minimum jerk
        start, target = np.array(state.start), np.array(state.target)
        yaw, pitch, distance = start + eased * (target - start)
        after = GazeState(**{**state.__dict__, "frame": state.frame + 1})
        return directions(yaw, pitch, distance), after

    def _next_fixation(self, state: GazeState) -> GazeState:
        number = state.fixation + 1
        bits = np.random.Philox(key=self.seed, counter=[0, 0, 1, number])
        draw = np.random.Generator(bits)
        if draw.random() < PARTNER_SHARE:
            yaw, pitch, distance = draw.normal(0, 1.2), draw.normal(0, 0.8), 1000.0
            seconds = draw.lognormal(np.log(0.9), 0.5)
        else:
            yaw, pitch = draw.normal(0, 10.0), draw.normal(-2, 5.0)
            distance, seconds = draw.uniform(600, 3000), draw.lognormal(np.log(0.45), 0.5)
        yaw, pitch = float(np.clip(yaw, -25, 25)), float(np.clip(pitch, -18, 15))
        amplitude = np.hypot(yaw - state.target[0], pitch - state.target[1])
        saccade = max((SACCADE_S + SACCADE_S_PER_DEG * float(amplitude)) * FPS, 1.0)
        end = max(round(seconds * FPS), int(saccade) + 3)
        return GazeState(number, 0, saccade, end, state.target, (yaw, pitch, float(distance)))


def directions(yaw: float, pitch: float, distance: float) -> NDArray[np.float32]:
    """Both eyes look at one point: yaw and pitch in degrees from between the eyes -> [2, 3]."""
    yaw, pitch = radians(yaw), radians(pitch)
    forward = np.array([np.sin(yaw) * np.cos(pitch), np.sin(pitch), np.cos(yaw) * np.cos(pitch)])
    eyes = np.array([[EYE_X_MM, 0.0, 0.0], [-EYE_X_MM, 0.0, 0.0]])
    rays = distance * forward - eyes
    return (rays / np.linalg.norm(rays, axis=1, keepdims=True)).astype(np.float32)
