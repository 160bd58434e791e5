"""`bench web` takes twenty minutes, and tells how far it is."""

import io
import sys

import numpy as np
import pytest

from app.bench.network.web import _play
from encoder.types import DrivenFrame
from render.types import AHEAD
from sensors.clock import ManualClock


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_it_tells_how_far_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """Red before: not a word until its end."""
    shown = Terminal()
    monkeypatch.setattr(sys, "stderr", shown)
    driven = [DrivenFrame(0, 0, np.zeros(256, np.float32), AHEAD)]
    assert _play(ManualClock(), driven, [], 2.0, "sending") == 60
    assert "sending: 100%" in shown.getvalue() and "60/60" in shown.getvalue()
