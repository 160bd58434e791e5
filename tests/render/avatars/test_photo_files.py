"""Photographs as people have them: what is refused in one line, and what is read."""

import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageEnhance

from render.avatars.photos.shape import detector, picture
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
    with pytest.raises(InputError, match=r"no.jpg: expected a photograph, got .*; save it as"):
        picture.read(tmp_path / "no.jpg")
    Image.new("RGB", (300, 200)).save(tmp_path / "tiny.png")
    with pytest.raises(InputError, match="at least 256 pixels each way, got 300 x 200"):
        picture.read(tmp_path / "tiny.png")
    (tmp_path / "link.jpg").symlink_to(photo)
    with pytest.raises(InputError):
        picture.read(tmp_path / "link.jpg")


def test_what_cannot_be_read_says_what_helps(
    tmp_path: Path, photo: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Red before: all of them should be saved as JPEG or PNG, which they were."""
    (tmp_path / "cut.jpg").write_bytes(photo.read_bytes()[:400])
    with pytest.raises(InputError, match=r"cut.jpg: .* got one that is cut off; copy it again"):
        picture.read(tmp_path / "cut.jpg")
    with pytest.raises(InputError, match="got a folder") as refused:
        picture.read(tmp_path)
    assert str(refused.value).count("expected") == 1
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 90_000)
    with pytest.raises(InputError, match=r"at most 0 million pixels, got more; scale it down"):
        picture.read(photo)


def test_sixteen_bits_of_grey_are_scaled(tmp_path: Path) -> None:
    """Red before: everything above 255 was white, so there was no face."""
    levels = np.linspace(0, 65535, 300 * 300).reshape(300, 300).astype(np.uint16)
    Image.fromarray(levels).save(tmp_path / "deep.png")
    pixels, _ = picture.read(tmp_path / "deep.png")
    assert np.abs(pixels - levels[..., None] / 257).max() < 1.01


@pytest.mark.parametrize(("saturation", "grey"), [(0.0, True), (0.2, False), (1.0, False)])
@pytest.mark.parametrize("skin", [(190, 140, 115), (52, 38, 30), (235, 205, 190)])
def test_a_photograph_without_colour_is_refused(
    tmp_path: Path, saturation: float, grey: bool, skin: tuple[int, int, int]
) -> None:
    """Red before: grey skin without a word. Faded colours are colours."""
    noise = np.random.default_rng(0).normal(0, 6, (500, 400, 1))
    shown = Image.fromarray((np.array(skin) + noise).clip(0, 255).astype(np.uint8))
    ImageEnhance.Color(shown).enhance(saturation).save(tmp_path / "me.jpg")
    pixels, lens_mm = picture.read(tmp_path / "me.jpg")
    see = partial(picture.seen, "me.jpg", pixels, lens_mm, Seeing(1))
    if grey:
        with pytest.raises(InputError, match=r"me.jpg: .* in colour, .* black-and-white one"):
            see()
    else:
        assert see().name == "me.jpg"


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
