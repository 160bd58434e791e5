"""`--avatar FILE` with a window: as `avatar create --out` tells its user to type it."""

import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from app.compose import build
from app.compose.settings import DriveSettings
from app.drive.stages import Stages
from app.drive.view import PortraitView
from app.window.sink import WindowSink
from render.decoder import identity
from render.decoder.learned.weights_file import FOLDER
from sensors.clock import ManualClock


@pytest.fixture
def file(tmp_path: Path) -> str:
    for suffix in (".json", ".safetensors"):
        shutil.copy(FOLDER / f"avatar_ada{suffix}", tmp_path / f"avatar_me{suffix}")
    return str(tmp_path / "avatar_me.safetensors")


def test_the_window_takes_a_file(file: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Red before: ValueError, as the list of names did not have it."""
    monkeypatch.setattr("app.window.sink.child.start", lambda *words: None)
    settings = DriveSettings(avatar=file, window=True)
    driver = SimpleNamespace(emotions=None)
    window = build._window(  # noqa: SLF001
        settings, None, driver, ManualClock(), Stages(), None, None, None  # type: ignore[arg-type]
    )  # fmt: skip
    assert isinstance(window, WindowSink)
    monkeypatch.setattr(window, "_process", SimpleNamespace(poll=lambda: None, wait=lambda s: 0))
    assert window.read().avatar == file
    window.close()


def test_a_file_is_loaded_once(file: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Red before: anew every tick, as its name is not the words that were typed."""
    renderer: Any = SimpleNamespace(name="none")
    view = PortraitView(renderer, identity.load(file), renderer, np.zeros(1))  # type: ignore[arg-type]
    loaded: list[str] = []
    load = identity.load
    monkeypatch.setattr(identity, "load", lambda name: (loaded.append(name), load(name))[1])
    for _ in range(5):
        view.show(file)
    assert loaded == [file]
