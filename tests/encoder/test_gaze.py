"""Synthesised gaze: unit vectors, rests and jumps like eyes, and repeats exactly."""

from __future__ import annotations

import numpy as np

from encoder.gaze import GazeState, GazeSynth, directions


def run(seed: int, frames: int, state: GazeState | None = None) -> tuple[np.ndarray, GazeState]:
    synth, gaze = GazeSynth(seed), []
    state = state or synth.init_state()
    for _ in range(frames):
        g, state = synth.step(state)
        gaze.append(g)
    return np.array(gaze), state


def test_unit_forward_and_repeatable() -> None:
    gaze, _ = run(1, 3000)
    assert gaze.shape == (3000, 2, 3) and gaze.dtype == np.float32
    assert np.abs(np.linalg.norm(gaze, axis=-1) - 1).max() < 1e-6
    assert (gaze[..., 2] > 0.8).all()
    assert np.array_equal(gaze, run(1, 3000)[0])
    assert not np.array_equal(gaze, run(2, 3000)[0])


def test_resumes_from_its_state() -> None:
    whole, _ = run(1, 200)
    first, state = run(1, 77)
    rest, _ = run(1, 123, state)
    assert np.array_equal(np.concatenate([first, rest]), whole)


def test_moves_like_eyes() -> None:
    gaze, _ = run(3, 9000)
    left = gaze[:, 0].astype(np.float64)
    cosine = np.clip((left[1:] * left[:-1]).sum(-1), -1, 1)
    speed = np.degrees(np.arccos(cosine)) * 30
    assert 0.6 < (speed < 1).mean() < 0.97  # mostly at rest
    assert speed.max() < 900  # degrees a second; faster eyes do not exist
    moving = (speed > 10).astype(int)
    saccades = np.count_nonzero(np.diff(moving) == 1) / 300
    assert 0.5 < saccades < 3  # a second


def test_eyes_converge_on_a_near_point() -> None:
    left, right = directions(0, 0, 500)
    assert left[0] < 0 < right[0]  # +x is the subject's left
    far = directions(0, 0, 1e6)
    assert abs(far[0, 0]) < 1e-4
