"""A live run draws as many Gaussians as the computer draws in time."""

from dataclasses import replace
from typing import Any

import pytest

from app.compose import density
from app.compose.settings import DriveSettings
from render.decoder import identity
from render.decoder.decoder import Decoder
from sensors.clock import ManualClock

LIVE = DriveSettings(fewer=True, realtime=True, draw=True, size=64)


@pytest.mark.parametrize(
    ("settings", "takes_ms", "drawn"),
    [
        (LIVE, {"65k": 10}, "65k"),
        (LIVE, {"65k": 30, "32k": 10}, "32k"),
        (LIVE, {"65k": 60, "32k": 30}, "16k"),  # however slow that is
        (replace(LIVE, draw=False, window=True), {"65k": 30, "32k": 10}, "32k"),
        (replace(LIVE, gaussians="32k"), {"32k": 30}, "16k"),
        (replace(LIVE, gaussians="16k"), {}, "16k"),
        (replace(LIVE, fewer=False), {}, "65k"),  # as many as were asked for
        (replace(LIVE, realtime=False), {}, "65k"),  # whose pictures may be late
        (replace(LIVE, draw=False), {}, "65k"),  # nothing is drawn here
    ],
)
def test_as_many_as_are_in_time(
    settings: DriveSettings, takes_ms: dict, drawn: str, monkeypatch: Any, capsys: Any
) -> None:
    timed: list[str] = []

    def takes(settings: DriveSettings, decoder: Decoder, *_: Any) -> float:
        timed.append(decoder.density)
        return takes_ms[decoder.density]

    monkeypatch.setattr(density, "picture_ms", takes)
    decoder = density.load_decoder(settings, identity.load("ben"), ManualClock())
    assert decoder.density == drawn and timed == list(takes_ms)
    told = capsys.readouterr().err
    assert ("--gaussians" in told) == (drawn != settings.gaussians)


class _Ticking(ManualClock):
    """Every look at it takes 2 ms."""

    def now_ns(self) -> int:
        self.advance_ns(2_000_000)
        return super().now_ns()


def test_what_a_picture_takes_is_measured() -> None:
    decoder, who = Decoder.load(gaussians="16k"), identity.load("ben")
    assert density.picture_ms(LIVE, decoder, who, _Ticking()) == 2
