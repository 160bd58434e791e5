"""Faces that sinks are given, and what the --arkit table says of them."""

import csv

import numpy as np
import pytest

from app.drive.sink import FrameResult, RunInfo
from app.sinks.arkit import ArkitSink
from encoder.types import DrivenFrame
from render.decoder.decoder import Decoder
from sensors.types import FPS, NS, SensorFrame


@pytest.fixture(scope="module")
def results(decoder: Decoder) -> list[FrameResult]:
    """Faces with every channel moving, and eyes that look in all directions."""
    rng = np.random.default_rng(3)
    made: list[FrameResult] = []
    for index in range(50):
        rig = rng.uniform(0, 1, 53).astype(np.float32)
        yaw, up = rng.uniform(-0.5, 0.5, (2, 2))
        gaze = np.stack([np.sin(yaw) * np.cos(up), np.sin(up), np.cos(yaw) * np.cos(up)], -1)
        t_ns = (index + 1) * NS // FPS
        silence, ages = np.zeros(1600, np.float32), np.full(2, -1, np.int64)
        frame = SensorFrame(index, t_ns, silence, None, np.zeros(2, bool), ages, False)
        driven = DrivenFrame(index, t_ns, decoder.encode(rig), gaze.astype(np.float32))
        made.append(FrameResult(frame, driven, None))
    return made


@pytest.fixture(scope="module")
def table(
    decoder: Decoder, results: list[FrameResult], tmp_path_factory: pytest.TempPathFactory
) -> list[dict[str, float]]:
    """The rows of the --arkit table by column name, of the same frames."""
    path = tmp_path_factory.mktemp("arkit") / "face.csv"
    sink = ArkitSink(path, decoder)
    sink.on_start(RunInfo(64, 64, len(results)))
    for result in results:
        sink.on_frame(result)
    sink.close()
    with path.open() as file:
        return [
            {k: float(v) for k, v in row.items() if k != "Timecode"} for row in csv.DictReader(file)
        ]
