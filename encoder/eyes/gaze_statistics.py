"""Fixations and saccades of a gaze sequence, to evaluate a walk."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sensors.types import FPS

SACCADE_DEG_S = 30.0  # faster is a saccade, slower a fixation
QUANTILES = (0.25, 0.5, 0.75, 0.9)


@dataclass(frozen=True, eq=False)
class GazeStatistics:
    dwell_s: NDArray[np.float64]  # [F] durations of the fixations
    amplitude_deg: NDArray[np.float64]  # [S] sizes of the saccades
    speed_deg_s: NDArray[np.float64]  # [S] their peak speeds


def step_deg(gaze: NDArray[np.floating]) -> NDArray[np.float64]:  # [T, 2, 3] -> [T - 1, 2]
    """Turn of each eye from frame to frame, degrees."""
    chord = np.linalg.norm(np.diff(gaze.astype(np.float64), axis=0), axis=-1)
    return np.degrees(2 * np.arcsin(np.clip(chord / 2, 0, 1)))


def gaze_statistics(gaze: NDArray[np.float32]) -> GazeStatistics:  # [T, 2, 3] unit vectors
    """Fixations and saccades of the mean of both eyes; cut ones at either end are left out."""
    middle = gaze.astype(np.float64).mean(1)
    middle /= np.linalg.norm(middle, axis=-1, keepdims=True)
    speed = step_deg(middle[:, None])[:, 0] * FPS
    fast = speed > SACCADE_DEG_S
    edges = np.concatenate([[0], np.flatnonzero(np.diff(fast)) + 1])
    dwell, amplitude, peak = [], [], []
    for start, end in zip(edges[1:-1], edges[2:], strict=True):
        if fast[start]:
            chord = float(np.linalg.norm(middle[end] - middle[start]))
            amplitude.append(float(np.degrees(2 * np.arcsin(min(chord / 2, 1.0)))))
            peak.append(float(speed[start:end].max()))
        else:
            dwell.append((end - start) / FPS)
    return GazeStatistics(np.array(dwell), np.array(amplitude), np.array(peak))


def compare(walk: GazeStatistics, source: GazeStatistics) -> dict[str, float]:
    """Relative differences walk / source - 1: mean and quantiles of dwell, amplitude and speed."""
    result = {}
    for name in ("dwell_s", "amplitude_deg", "speed_deg_s"):
        a, b = getattr(walk, name), getattr(source, name)
        result[f"{name}_mean"] = float(a.mean() / b.mean() - 1)
        for q in QUANTILES:
            result[f"{name}_p{round(100 * q)}"] = float(np.quantile(a, q) / np.quantile(b, q) - 1)
    return result
