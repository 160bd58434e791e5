"""`livedrive avatar create` as a user types it."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from app.avatar import Create
from render import identity
from render.errors import InputError


@pytest.fixture
def files(tmp_path: Path) -> dict[str, Path]:
    np.savez(tmp_path / "g.npz", vertices=identity.load("kofi").geometry)
    Image.new("RGB", (512, 256), (190, 140, 115)).save(tmp_path / "t.png")
    return {"geometry": tmp_path / "g.npz", "texture": tmp_path / "t.png", "out": tmp_path}


def test_a_scan_becomes_an_avatar_with_hair_and_a_card(files: dict[str, Path]) -> None:
    Create(name="me", eye="green", hair="ben", **files).run()
    who = identity.load("me", files["out"])
    assert identity.names(files["out"]) == ["me"]
    assert np.abs(who.geometry - identity.load("kofi").geometry).max() < 0.02
    assert len(who.hair) == len(identity.load("ben").hair)
    assert '"geometry": "g.npz"' in (files["out"] / "avatar_me.json").read_text()


@pytest.mark.parametrize(
    ("name", "hair"), [("Me", None), ("all", None), ("a b", None), ("me", "x")]
)
def test_a_wrong_word_is_refused_before_the_work(
    files: dict[str, Path], name: str, hair: str | None
) -> None:
    with pytest.raises(InputError, match="expected"):
        Create(name=name, hair=hair, eye="brown", **files).run()
    assert identity.names(files["out"]) == []
