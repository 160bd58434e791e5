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
from app.window.head import HeadView
from app.window.sink import WindowSink
from render.decoder import identity
from render.decoder.identity import Identity
from render.decoder.learned.weights_file import FOLDER
from render.gl.contexts import create_context
from sensors.clock import ManualClock
from sensors.types import InputError


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


def test_the_window_loads_a_file_once_and_survives_a_damaged_one(
    file: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Red before: anew with every picture; and a damaged one, picked from the list, ended it."""
    with monkeypatch.context() as patch:
        head = HeadView(create_context(), file, 64, "16k")
        patch.setattr(identity, "load", pytest.fail)
        assert not head.choose(file)
    assert head.choose("kofi")
    Path(file).with_suffix(".json").write_text("{")
    with pytest.raises(InputError, match="a damaged file"):
        head.choose(file)
    assert not head.choose(file) and head.identity.name == "kofi"


def test_a_damaged_avatar_that_is_picked_leaves_the_one_that_is_drawn(file: str) -> None:
    """Red before: it ended the run."""
    drawn: list[Identity] = []
    decoder: Any = SimpleNamespace(decode=lambda x, g, who, *_, **__: (x, drawn.append(who)))
    renderer: Any = SimpleNamespace(name="", draw=lambda *_: None, read_rgba=lambda: None)
    view = PortraitView(decoder, identity.load("kofi"), renderer, None)  # type: ignore[arg-type]
    Path(file).with_suffix(".json").write_text("{")
    view.show(file)
    view.warm_up()
    assert [who.name for who in drawn] == ["kofi"]
