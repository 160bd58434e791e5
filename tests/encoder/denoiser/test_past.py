"""The denoiser's keys and values on the live path: stale ones, very late ones, no copies."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from driver_material import drive, driver, sensor_frame, sound

from encoder.backends import BackendName


def test_stale_cache_is_never_read() -> None:
    """NaN where torch masks by `where`, large numbers where ONNX masks by a bias."""
    for backend, junk in (("torch", np.nan), ("onnx", 1e3)):
        d, audio = driver(backend), sound(40)
        expected, _, _ = drive(d, audio)
        state = d.init_state(5)
        if backend == "torch":
            past = {k: v + junk if k != "frame" else v for k, v in state.backend.past.items()}
            state = replace(state, backend=replace(state.backend, past=past))
        else:
            state.backend.past.ring.keys[:] = junk
            state.backend.past.ring.values[:] = junk
        actual, _, _ = drive(d, audio, state)
        assert np.array_equal(actual, expected)


@pytest.mark.parametrize("backend", ["torch", "onnx"])
def test_four_days_change_nothing(backend: BackendName) -> None:
    """Only relative positions count, so frame 10 000 000 must act like frame 1000."""
    d, audio, results = driver(backend), sound(30), []
    for frame in (1000, 10_000_000):
        state = d.init_state(5)
        if backend == "torch":
            past = {**state.backend.past, "frame": torch.tensor(frame)}
        else:
            past = replace(state.backend.past, frame=frame)
        state = replace(state, backend=replace(state.backend, past=past))
        results.append(drive(d, audio, state)[0])
    assert np.abs(results[0] - results[1]).max() < 1e-5 * np.abs(results[0]).max()


def test_the_cache_is_not_copied() -> None:
    d = driver("onnx")
    state = d.init_state(5)
    rings = set()
    for i, chunk in enumerate(sound(60)):
        _, state = d.step(sensor_frame(i, chunk), state)
        rings.add(id(state.backend.past.ring.keys))
    assert len(rings) == 1
