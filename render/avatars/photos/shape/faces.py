"""The faces in a photograph, small ones too: the detector sees a picture as a whole, and of a small
face too little.

It misses faces of less than an eighth of a picture, and finds them in parts of it; in a cut-out
around a face its points lie twice as near.
"""

import numpy as np
from numpy.typing import NDArray

from render.avatars.photos.shape.detector import OVAL, FaceDetector
from render.types import Doubles

# Heights over widths of faces: 1.04 to 1.5, the more the farther aside they look; of the same
# upside down .95 to 1.7. Of 72 none below the first was taller upside down by half the second.
LOW, TALLER = 1.2, 0.07
# Faces of less than such a share of a picture are looked at once more, in a cut-out of so many
# times their size.
SMALL, AROUND = 0.25, 2.5
Box = tuple[int, int, int, int]  # left, top, width, height; px


def upright(
    picture: NDArray[np.uint8], detector: FaceDetector
) -> tuple[NDArray[np.uint8], list[Doubles]]:
    """The picture, turned by half where it stands on its head, and its faces.

    The detector finds an upright face in one that is upside down, too, but a low one."""
    found = find(picture, detector)
    if len(found) > 1 or (found and _height(found[0]) > LOW):
        return picture, found
    turned = np.ascontiguousarray(picture[::-1, ::-1])
    there = find(turned, detector)
    taller = not found or (there and _height(there[0]) > _height(found[0]) + TALLER)
    return (turned, there) if len(there) == 1 and taller else (picture, found)


def find(picture: NDArray[np.uint8], detector: FaceDetector) -> list[Doubles]:
    """[H, W, 3] -> points [478, 2] px of each face; where the whole shows none, of those that its
    parts show."""
    found = detector.faces(picture)
    if not found:
        for part in _parts(picture):
            found += [face for face in _within(picture, part, detector) if _is_new(face, found)]
    return [_from_near(picture, face, detector) for face in found]


def _parts(picture: NDArray[np.uint8]) -> list[Box]:
    """Parts of half its size, each half over the next."""
    height, width = picture.shape[:2]
    return [
        (x * width // 4, y * height // 4, width // 2, height // 2)
        for y in range(3)
        for x in range(3)
    ]


def _within(picture: NDArray[np.uint8], box: Box, detector: FaceDetector) -> list[Doubles]:
    left, top, width, height = box
    part = picture[top : top + height, left : left + width]
    return [face + (left, top) for face in detector.faces(part)]


def _from_near(picture: NDArray[np.uint8], face: Doubles, detector: FaceDetector) -> Doubles:
    """The same face in a cut-out around it, where it is small."""
    (x, y), size = _place(face)
    height, width = picture.shape[:2]
    if size > SMALL * max(height, width):
        return face
    reach = AROUND / 2 * size
    left, top = int(max(x - reach, 0)), int(max(y - reach, 0))
    box = left, top, int(min(x + reach, width)) - left, int(min(y + reach, height)) - top
    again = [near for near in _within(picture, box, detector) if not _is_new(near, [face])]
    return again[0] if again else face


def _is_new(face: Doubles, known: list[Doubles]) -> bool:
    """It is none of them, found once more."""
    (middle, size), others = _place(face), [_place(other)[0] for other in known]
    return all(float(np.linalg.norm(middle - other)) > size / 2 for other in others)


def _height(face: Doubles) -> float:
    """From forehead to chin, over the width between the temples."""
    top, bottom, right, left = face[[10, 152, 127, 356]]
    return float(np.linalg.norm(top - bottom) / np.linalg.norm(left - right))


def _place(face: Doubles) -> tuple[Doubles, float]:
    """Middle [2] and size of its oval, px."""
    edge = face[list(OVAL)]
    return (edge.min(0) + edge.max(0)) / 2, float(np.ptp(edge, axis=0).max())
