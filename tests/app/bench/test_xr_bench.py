"""The bench of a headset, short: what it counts does not depend on speed."""

from functools import partial
from pathlib import Path

import pytest
import soundfile

from app.bench.xr import ticks
from app.compose.settings import DriveSettings
from app.xr.link import XrInfo
from sensors.session import files as session
from sensors.types import SAMPLE_RATE

pytestmark = pytest.mark.slow
ROOT = Path(__file__).parents[3]


def test_ticks_are_measured_with_a_headset_and_without(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(ticks, "ROUNDS", 1)
    monkeypatch.setattr(ticks, "SIZE", (48, 32))
    small = partial(DriveSettings, size=64, gaussians="16k")
    monkeypatch.setattr("app.compose.settings.DriveSettings", small)
    monkeypatch.setattr("app.xr.link.XrInfo", partial(XrInfo, gaussians="16k"))
    speech, _ = soundfile.read(ROOT / "recordings" / "smoke" / "audio.wav", frames=SAMPLE_RATE)
    soundfile.write(tmp_path / "second.wav", speech, SAMPLE_RATE)
    session.create(tmp_path / "second", tmp_path / "second.wav")
    metrics, thresholds = ticks.measure_ticks(tmp_path / "second", "ben")
    assert metrics["off_tick_p50_ms"] > 0 and metrics["on_tick_p50_ms"] > 0
    for way in ("on", "window"):
        assert metrics[f"{way}_fps"] > 0 and 0.5 <= metrics[f"{way}_share"] <= 1
    judged = [row["name"] for row in thresholds]
    parts = (*ticks.PARTS, "crashes")
    assert judged == [f"{way}_{part}" for way in ("on", "window") for part in parts]
