"""The bench of a headset, short: what it counts does not depend on speed."""

from functools import partial
from pathlib import Path

import pytest

from app.bench.xr import ticks
from app.compose.settings import DriveSettings
from app.xr.link import XrInfo

pytestmark = pytest.mark.slow


def test_ticks_are_measured_with_a_headset_and_without(
    monkeypatch: pytest.MonkeyPatch, second: Path
) -> None:
    monkeypatch.setattr(ticks, "ROUNDS", 1)
    monkeypatch.setattr(ticks, "SIZE", (48, 32))
    small = partial(DriveSettings, size=64, gaussians="16k")
    monkeypatch.setattr("app.compose.settings.DriveSettings", small)
    monkeypatch.setattr("app.xr.link.XrInfo", partial(XrInfo, gaussians="16k"))
    metrics, thresholds = ticks.measure_ticks(second, "ben")
    assert metrics["off_tick_p50_ms"] > 0 and metrics["on_tick_p50_ms"] > 0
    for way in ("on", "window"):
        assert metrics[f"{way}_fps"] > 0 and 0.5 <= metrics[f"{way}_share"] <= 1
    judged = [row["name"] for row in thresholds]
    parts = (*ticks.PARTS, "crashes")
    assert judged == [f"{way}_{part}" for way in ("on", "window") for part in parts]
