"""ONNX Runtime has the thread that drives take denormals for zero; what runs there must bear it."""

import numpy as np
import pytest

from encoder.inference import load_driver
from render.decoder import prior_file
from render.decoder.decoder import Decoder
from sensors.types import SensorFrame


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["16k", "32k"])
def test_a_decoder_loads_where_a_driver_runs(preset, monkeypatch):
    monkeypatch.setattr(prior_file, "_known", {})  # no test before it has loaded one
    driver = load_driver(None, "cpu")
    frame = SensorFrame(
        index=0, t_ns=0, audio=np.zeros(1600, np.float32), eyes=None,
        eyes_valid=np.zeros(2, bool), eyes_age_ns=np.full(2, -1, np.int64), audio_gap=False,
    )  # fmt: skip
    driver.step(frame, driver.init_state(0))
    assert np.float32(1e-40) * np.float32(1) == 0 or driver.backend.name == "torch"
    assert len(Decoder.load(gaussians=preset).opacities) >= 16_000
