"""The shipped session through the shipped weights: repeatable, causal, the same at any pace."""

from pathlib import Path

import numpy as np
import pytest

from encoder.driver import Driver
from encoder.inference import load_driver
from encoder.types import DrivenFrame
from sensors.assemble import Assembler
from sensors.clock import ManualClock
from sensors.session.files import replay_frames
from sensors.session.recording import Recording
from sensors.session.replay import ReplaySource
from sensors.types import NS, SensorFrame

SMOKE = Path(__file__).parent.parent / "recordings" / "smoke"


@pytest.fixture(scope="module")
def driver() -> Driver:
    return load_driver(device="cpu")


@pytest.fixture(scope="module")
def frames() -> list[SensorFrame]:
    with Recording(SMOKE) as recording:
        return list(replay_frames(recording))


def drive(driver: Driver, frames: list[SensorFrame]) -> list[DrivenFrame]:
    state, out = driver.init_state(0), []
    for frame in frames:
        driven, state = driver.step(frame, state)
        out.append(driven)
    return out


def codes(driven: list[DrivenFrame]) -> np.ndarray:
    return np.array([np.concatenate([d.expression, d.gaze.ravel()]) for d in driven])


def test_twice_is_equal(driver: Driver, frames: list[SensorFrame]) -> None:
    assert len(frames) == 90
    np.testing.assert_array_equal(codes(drive(driver, frames)), codes(drive(driver, frames)))


def test_real_time_is_equal_to_fast(driver: Driver, frames: list[SensorFrame]) -> None:
    clock, assembler, live = ManualClock(), Assembler(), []
    with Recording(SMOKE) as recording:
        source = ReplaySource(recording, clock, realtime=True)
        source.open()
        while not source.exhausted:
            clock.advance_ns(NS // 47)
            for packet in source.poll():
                assembler.push(packet)
            live += assembler.ready()
        source.close()
    np.testing.assert_array_equal(codes(drive(driver, live)), codes(drive(driver, frames)))


def test_the_last_second_changes_no_earlier_frame(
    driver: Driver, frames: list[SensorFrame]
) -> None:
    changed = [
        f if f.index < 60 else SensorFrame(**{**vars(f), "audio": np.full_like(f.audio, np.nan)})
        for f in frames
    ]
    before, after = codes(drive(driver, frames)), codes(drive(driver, changed))
    np.testing.assert_array_equal(before[:60], after[:60])
    assert not np.array_equal(before[60:], after[60:])


def test_the_mouth_moves_with_speech(driver: Driver, frames: list[SensorFrame]) -> None:
    moved = np.ptp(codes(drive(driver, frames))[:, :256], axis=0)
    assert moved.max() > 0.1
