"""Where `livedrive train prior` keeps what another run takes up again."""

from pathlib import Path
from typing import Any

import pytest

from app.commands.train import Train
from render.training import prior


def test_another_seed_or_take_has_a_folder_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Red before: fit, networks and expressions of the former were taken, and shipped as its."""
    folders = list[Path]()
    monkeypatch.setattr(prior, "run", lambda face, out, preset, work, *_: folders.append(work))
    (tmp_path / "a.csv").write_text("a")
    (tmp_path / "b.csv").write_text("b")
    runs: list[dict[str, Any]] = [{}, {"seed": 1}, {"take": "a.csv"}, {"take": "b.csv"}]
    for given in runs * 2:
        take = {"take": tmp_path / given["take"]} if "take" in given else {}
        Train(stage="prior", data=tmp_path, out=tmp_path, **given | take).run()
    assert folders[:4] == folders[4:] and len(set(folders)) == 4
