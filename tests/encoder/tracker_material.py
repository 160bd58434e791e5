"""Eyes that are seen or lost, frame by frame, and what a tracker shows of them."""

from __future__ import annotations

import numpy as np
from eye_material import encoder, graph, looks

from encoder.eyes.calibration import EyeCalibration
from encoder.eyes.conjugate import joined
from encoder.eyes.encoder import EyeReading
from encoder.eyes.fading import ShownEyes
from encoder.eyes.gaze_walk import GazeWalk
from encoder.eyes.tracker import EyeState, EyeTracker

ENCODER, GRAPH = encoder(), graph()
BOTH = np.ones(2, bool)


def tracker() -> EyeTracker:
    return EyeTracker(ENCODER, GazeWalk(GRAPH, 7))


def readings(frames: int, seed: int = 1) -> list[EyeReading]:
    """Consistent ones: features are what the encoder's own map says of the gaze."""
    lids, score = np.ones(2, np.float32), np.ones(2, np.float32)
    return [
        EyeReading(ENCODER.synthesise(gaze, lids), gaze, lids, score, gaze, gaze)
        for gaze in looks(frames, seed)
    ]


def follow(
    rows: list[EyeReading | None], good: np.ndarray, state: EyeState | None = None
) -> tuple[list[ShownEyes], list[EyeState]]:
    track = tracker()
    state, seen, states = state or track.init_state(EyeCalibration()), [], []
    for reading, fresh in zip(rows, good, strict=True):
        shown, state = track.step(reading, fresh, state)
        assert all(np.isfinite(array).all() for array in shown)
        assert np.abs(np.linalg.norm(shown.gaze, axis=1) - 1).max() < 1e-5
        assert shown.gaze.dtype == shown.features.dtype == shown.lids.dtype == np.float32
        seen.append(shown)
        states.append(state)
    return seen, states


def both_of(rows: list[EyeReading]) -> np.ndarray:
    """Where both eyes look while both are seen [T, 2, 3]."""
    return np.array([joined(r.told(), r.lids, r.score) for r in rows])


def gaze_of(seen: list[ShownEyes]) -> np.ndarray:
    return np.array([s.gaze for s in seen])
