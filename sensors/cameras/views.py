"""From a camera's picture to one 400 x 400 view for each eye: crop, turn, split, mirror, scale."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sensors.picture import MIN_SIDE, BadPictureError
from sensors.types import EYE_SIZE


@dataclass(frozen=True, kw_only=True)
class Views:
    """How the views lie in the picture. The default is both eyes side by side, left first."""

    eyes: tuple[int, ...] = (0, 1)  # which eyes the picture shows, from left to right
    crop: tuple[int, int, int, int] | None = None  # x, y, width, height in px, before turning
    turns: int = 0  # quarter turns, counter-clockwise, of each view
    mirror: bool = False  # each view, left to right

    def cut(
        self,
        image: NDArray[np.uint8],  # [H, W]
    ) -> list[tuple[int, NDArray[np.uint8]]]:
        """(eye, view [400, 400]) for each eye."""
        return [(eye, self.view(image, k)) for k, eye in enumerate(self.eyes)]

    def view(
        self,
        image: NDArray[np.uint8],  # [H, W]
        k: int,  # of the eyes from left to right
    ) -> NDArray[np.uint8]:
        """[400, 400]. Raises BadPictureError where the crop reaches beyond the picture, or leaves
        too little."""
        if self.crop is not None:
            x, y, width, height = self.crop
            if x + width > image.shape[1] or y + height > image.shape[0]:
                wide, high = image.shape[1], image.shape[0]
                raise BadPictureError(f"a crop beyond the picture of {wide} x {high}; check crop=")
            image = image[y : y + height, x : x + width]
        half = image.shape[1] // len(self.eyes)
        if min(half, image.shape[0]) < MIN_SIDE:
            raise BadPictureError(f"views of {half} x {image.shape[0]} px; check crop=")
        view = np.rot90(image[:, k * half : (k + 1) * half], self.turns)
        return fit(view[:, ::-1] if self.mirror else view)


def fit(
    image: NDArray[np.uint8],  # [H, W]
) -> NDArray[np.uint8]:
    """[400, 400] of the centre square. A view of half width (VIVE) is stretched, not cut."""
    height, width = image.shape
    if height != 2 * width:
        side = min(height, width)
        top, left = (height - side) // 2, (width - side) // 2
        image = image[top : top + side, left : left + side]
    if image.shape == (EYE_SIZE, EYE_SIZE):
        return np.ascontiguousarray(image)
    from PIL import Image

    shrinks = min(image.shape) > EYE_SIZE
    method = Image.Resampling.BOX if shrinks else Image.Resampling.BICUBIC
    scaled = Image.fromarray(np.ascontiguousarray(image)).resize((EYE_SIZE, EYE_SIZE), method)
    return np.asarray(scaled)
