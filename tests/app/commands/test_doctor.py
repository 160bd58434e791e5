"""`livedrive doctor`: the user's avatars, and what making one needs."""

import shutil
import sys
from pathlib import Path

import pytest

from app.avatars import pictures
from app.commands import doctor
from render.decoder.learned import avatar_files, weights_file


def test_avatars_of_the_user_are_among_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Red before: the shipped ones alone."""
    monkeypatch.setattr(avatar_files, "user_folder", lambda: tmp_path)
    for suffix in (".json", ".safetensors"):
        shutil.copy(weights_file.FOLDER / f"avatar_ada{suffix}", tmp_path / f"avatar_me{suffix}")
    told = doctor.CHECKS["avatars"]()
    assert {"ada", "me"} <= set(told.split(", "))
    (tmp_path / "avatar_me.json").unlink()
    with pytest.raises(ValueError, match=r"avatar_me.json beside .*, got no such file; copy"):
        doctor.CHECKS["avatars"]()


@pytest.mark.parametrize(
    ("check", "module", "words"),
    [
        ("photographs", "mediapipe", "only avatar create --photos needs it"),
        ("scans", "trimesh", "only avatar create --geometry needs it"),
    ],
)
def test_what_making_an_avatar_needs_is_named(
    check: str, module: str, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Red before: no word of it."""
    monkeypatch.setitem(sys.modules, module, None)
    told = doctor.CHECKS[check]()
    assert words in told and "run: pip install 'livedrive[" in told


def test_a_damaged_avatar_does_not_keep_the_others_from_being_drawn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Red before: `avatar show all` ended with it."""
    monkeypatch.setattr(avatar_files, "user_folder", lambda: tmp_path)
    (tmp_path / "avatar_me.safetensors").write_bytes(b"")
    names = [who.name for who in pictures.everybody()]
    assert names == avatar_files.shipped()
    assert capsys.readouterr().err.startswith("livedrive: me is left out: weights: expected ")
