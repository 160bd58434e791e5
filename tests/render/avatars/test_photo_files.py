"""Photographs as people have them: what is refused in one line, and what is read."""

import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from render.avatars.photos import detector, picture
from render.types import Doubles
from sensors.types import InputError


class Seeing:
    """A detector that finds so many faces, so wide."""

    def __init__(self, count: int, width: float = 300.0) -> None:
        points = np.random.default_rng(0).uniform(0, width, (detector.POINTS, 2)) + 40
        self._faces = [points] * count

    def faces(self, picture: object) -> list[Doubles]:
        return self._faces


@pytest.fixture
def photo(tmp_path: Path) -> Path:
    Image.new("RGB", (400, 500), (190, 140, 115)).save(tmp_path / "me.jpg")
    return tmp_path / "me.jpg"


@pytest.mark.parametrize(
    ("seeing", "words"),
    [
        (Seeing(0), r"me.jpg: expected one face, .* got none; take it from the front"),
        (Seeing(2), r"me.jpg: expected one face, .* got 2; cut the others away"),
        (Seeing(1, 80.0), r"me.jpg: expected a face at least 120 pixels wide, got 7\d; take it"),
    ],
)
def test_a_photograph_shows_one_face(photo: Path, seeing: Seeing, words: str) -> None:
    with pytest.raises(InputError, match=words):
        picture.load((photo,), seeing)  # pyright: ignore[reportArgumentType]


def test_there_are_one_to_five_photographs(photo: Path) -> None:
    with pytest.raises(InputError, match=r"--photos: expected 1\.\.5 of one person, got 6"):
        picture.load((photo,) * 6, Seeing(1))  # pyright: ignore[reportArgumentType]


def test_what_is_no_photograph_is_refused(tmp_path: Path, photo: Path) -> None:
    (tmp_path / "no.jpg").write_bytes(b"no")
    (tmp_path / "cut.jpg").write_bytes(photo.read_bytes()[:400])
    for name in ("no.jpg", "cut.jpg"):
        with pytest.raises(InputError, match=f"{name}: expected a photograph, got .*; save it as"):
            picture.read(tmp_path / name)
    Image.new("RGB", (300, 200)).save(tmp_path / "tiny.png")
    with pytest.raises(InputError, match="at least 256 pixels each way, got 300 x 200"):
        picture.read(tmp_path / "tiny.png")
    (tmp_path / "link.jpg").symlink_to(photo)
    with pytest.raises(InputError):
        picture.read(tmp_path / "link.jpg")


def test_a_phone_that_was_turned_and_its_lens(tmp_path: Path) -> None:
    image = Image.new("RGB", (600, 300))
    exif = image.getexif()
    exif[0x0112] = 6  # turned
    exif.get_ifd(picture.EXIF)[picture.LENS_35MM] = 26
    image.save(tmp_path / "turned.jpg", exif=exif)
    pixels, lens_mm = picture.read(tmp_path / "turned.jpg")
    assert pixels.shape == (600, 300, 3)
    assert lens_mm == 26.0


def test_without_the_extra_the_command_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mediapipe", None)
    with pytest.raises(InputError, match=r"run: pip install 'livedrive\[photos\]'"):
        detector.FaceDetector()
