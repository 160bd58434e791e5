"""What a view does before the first tick."""

from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from app.drive.view import PortraitView
from encoder.types import DrivenFrame
from render import cameras
from render.decoder import identity
from render.types import AHEAD
from sensors.rotation import REST


def test_an_avatar_that_cannot_be_read_leaves_the_old_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Red before: a file of another user ended the run."""
    renderer: Any = SimpleNamespace(name="")
    drawn: Any = SimpleNamespace()
    view = PortraitView(drawn, identity.load("ben"), renderer, cameras.portrait(8, 8))

    def refuse(name: str) -> None:
        raise PermissionError(13, "Permission denied", name)

    monkeypatch.setattr(identity, "load", refuse)
    view.show("mine.safetensors")


def test_a_turned_head_that_breathes_is_drawn_before_the_first_tick() -> None:
    """Red before: a head at rest was, so the first tick met a neck in 20 ms more, and the second
    was not drawn."""
    calls: list[dict[str, Any]] = []

    def decode(code: Any, gaze: Any, who: Any, head: Any = REST, breath: float = 0.0, **rest: Any):
        calls.append({"rest": head == REST, "breath": breath, **rest})
        return None, None

    counting: Any = SimpleNamespace(decode=decode)
    picture = np.zeros((8, 8, 4), np.uint8)
    renderer: Any = SimpleNamespace(name="", draw=lambda *_: None, read_rgba=lambda: picture)
    view = PortraitView(counting, identity.load("ben"), renderer, cameras.portrait(8, 8))
    view.warm_up()
    view.draw(DrivenFrame(0, 0, np.zeros(256, np.float32), AHEAD), lambda _: nullcontext())
    assert not calls[0]["rest"] and calls[0]["breath"] > 0
    assert calls[0].keys() == calls[1].keys()  # the way of every tick
