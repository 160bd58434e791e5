"""Photographs from files: turned upright, not larger than needed, and what the file tells of the
lens.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from render.avatars import textures
from render.avatars.photos.shape import faces
from render.avatars.photos.shape.detector import ON_SKIN, OVAL, FaceDetector
from render.avatars.photos.shape.fit import PhotoView
from render.types import Doubles
from sensors.types import InputError

MOST = 5  # photographs
SMALLEST_PX, LARGEST_PX = 256, 2048  # of a picture's shorter side; larger ones are reduced
GREY_LEVELS = 3  # of 255 between the channels of a face without colour
FACE_PX = 120  # width of a face that shows enough
EXIF, LENS_35MM = 0x8769, 0xA405  # tags
LENSES_MM = (8, 400)


@dataclass(frozen=True)
class Photo:
    name: str
    picture: NDArray[np.uint8]  # [H, W, 3]
    lens_mm: float | None  # as of a 35 mm film
    points: Doubles  # [478, 2] px, see detector.py

    @property
    def view(self) -> PhotoView:
        height, width = self.picture.shape[:2]
        return PhotoView(self.points[:ON_SKIN], (width, height), self.lens_mm)


def load(paths: tuple[Path, ...], detector: FaceDetector) -> list[Photo]:
    """Raises InputError where there are too many, one is no picture, or shows not one face."""
    if not 1 <= len(paths) <= MOST:
        raise InputError(
            f"--photos: expected 1..{MOST} of one person, got {len(paths)}; give the front, then "
            "sides"
        )
    return [seen(str(path), *read(path), detector) for path in paths]


def seen(
    name: str, picture: NDArray[np.uint8], lens_mm: float | None, detector: FaceDetector
) -> Photo:
    """With the one face that it shows."""
    picture, found = faces.upright(picture, detector)
    if len(found) != 1:
        got = f"{len(found)}; cut the others away" if found else "none; take it from the front"
        raise InputError(f"{name}: expected one face, looking at most 60 degrees aside, got {got}")
    width = float(np.ptp(found[0][list(OVAL), 0]))
    if width < FACE_PX:
        raise InputError(
            f"{name}: expected a face at least {FACE_PX} pixels wide, got {width:.0f}; take it "
            "from nearer"
        )
    if is_grey(picture, found[0]):
        raise InputError(
            f"{name}: expected a photograph in colour, for the colours of the skin, got a "
            "black-and-white one; leave it out, or take another"
        )
    return Photo(name, picture, lens_mm, found[0])


def is_grey(picture: NDArray[np.uint8], points: Doubles) -> bool:
    """Without colour around these points [478, 2]; pale and dark skin has some."""
    (left, top), (right, bottom) = points.min(0).astype(int), points.max(0).astype(int)
    face = picture[max(top, 0) : bottom + 1, max(left, 0) : right + 1]
    return float(np.percentile(np.ptp(face, axis=2), 90)) < GREY_LEVELS


def read(path: Path) -> tuple[NDArray[np.uint8], float | None]:
    """Pixels [H, W, 3], upright; the lens, where the file tells it."""
    from PIL import Image, ImageOps

    with textures.opened(path, "a photograph") as image:
        told = image.getexif().get_ifd(EXIF).get(LENS_35MM)
        upright = textures.rgb(ImageOps.exif_transpose(image))
    if min(upright.size) < SMALLEST_PX:
        raise InputError(
            f"{path}: expected at least {SMALLEST_PX} pixels each way, got {upright.width} x "
            f"{upright.height}; take a larger one"
        )
    if min(upright.size) > LARGEST_PX:
        factor = LARGEST_PX / min(upright.size)
        size = (round(upright.width * factor), round(upright.height * factor))
        upright = upright.resize(size, Image.Resampling.LANCZOS)
    lens = float(told) if isinstance(told, int) else 0.0
    known = LENSES_MM[0] <= lens <= LENSES_MM[1]
    return np.asarray(upright, np.uint8), lens if known else None
