"""`livedrive calibrate`: the routine's schedule, what it collects, and where it is kept."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from app.commands.calibrate import Calibrate, collect
from app.drive.calibration import in_session, of_session, of_user, profile_path
from encoder.eyes.calibration import ROUTINE, EyeCalibration
from encoder.eyes.encoder import EyeReading
from render.types import AHEAD
from sensors.clock import ManualClock
from sensors.types import AudioPacket, EyePacket, InputError, Packet, SourceInfo


class Pictures:
    """Ten seconds of pictures whose grey says which frame they are."""

    info = SourceInfo("test", eyes=(0, 1))
    dropped = 0

    def __init__(self, frames: int = 310) -> None:
        self.count, self.frames = 0, frames

    @property
    def exhausted(self) -> bool:
        return self.count >= self.frames

    def open(self) -> None: ...
    def close(self) -> None: ...

    def poll(self) -> list[Packet]:
        t, self.count = self.count, self.count + 1
        t_ns = t * 1_000_000_000 // 30
        image = np.full((400, 400), t % 250, np.uint8)
        eyes: list[Packet] = [EyePacket(t_ns, eye, t, image) for eye in (0, 1)]
        return [*eyes, AudioPacket(t_ns, 1600 * t, np.zeros(1600, np.float32))]


class Grey:
    """An encoder that reads the lid off the grey; the right eye is never seen."""

    def step(self, eyes: np.ndarray, framing: object) -> tuple[EyeReading, object]:
        lids, score = eyes[:, 0, 0].astype(np.float32) / 250, np.float32([0.9, 0.1])
        features = np.zeros((2, 80), np.float32)
        return EyeReading(features, AHEAD, lids, score, AHEAD, AHEAD), framing


grey = Grey()


def test_collects_what_each_target_showed() -> None:
    said: list[str] = []
    takes = collect(Pictures(), grey, ManualClock(), said.append, live=False)  # type: ignore[arg-type]
    assert [take.target for take in takes] == list(ROUTINE)
    assert len(said) == len(ROUTINE) and said[0] == "look straight ahead"
    assert said[1].endswith("left") and said[4].endswith("down")
    assert sum(len(take.gaze) for take in takes) == 300
    second = takes[1]
    assert np.array_equal(np.rint(250 * second.lids[:, 0]), np.arange(42, 84))
    assert second.good[:, 0].all() and not second.good[:, 1].any()


def test_a_short_recording_is_one_line() -> None:
    with pytest.raises(InputError, match="whole routine"):
        collect(Pictures(50), grey, ManualClock(), lambda _: None, live=False)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="neither"):
        Calibrate().run()


def test_is_kept_for_the_user_and_in_the_session(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    assert of_user() is None
    calibration = EyeCalibration(shift=((0.1, 0.0), (0.0, 0.2)))
    calibration.save(profile_path())
    assert of_user() == calibration
    kept = in_session(SimpleNamespace(calibration=calibration))  # type: ignore[arg-type]
    recording = SimpleNamespace(card={"calibration": kept}, folder=tmp_path)
    assert of_session(recording) == calibration  # type: ignore[arg-type]
    empty = SimpleNamespace(card={"calibration": {}}, folder=tmp_path)
    assert of_session(empty) is None  # type: ignore[arg-type]
    assert in_session(SimpleNamespace(calibration=None)) == {}  # type: ignore[arg-type]
