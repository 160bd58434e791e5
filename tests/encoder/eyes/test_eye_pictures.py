"""What the networks see of a picture of the eyes: means of pixels, mirrored, at any exposure."""

from __future__ import annotations

import numpy as np
import pytest
from eye_material import pair

from encoder.eyes.format import normalised, pixels


@pytest.mark.parametrize("shrink", [1, 2, 3, 4])
def test_small_pictures_are_means_to_the_bit(shrink: int) -> None:
    n = 100 * shrink
    for eyes in np.random.default_rng(0).integers(0, 256, (3, 2, n, n), dtype=np.uint8):
        blocks = eyes.reshape(2, 100, shrink, 100, shrink).astype(np.int64).sum((2, 4))
        expected = ((blocks + shrink**2 // 2) // shrink**2).astype(np.uint8)
        assert np.array_equal(pixels(eyes), np.stack([expected[0], expected[1, :, ::-1]]))
    most = np.full((2, n, n), 255, np.uint8)
    assert (pixels(most) == 255).all() and (pixels(most[:, ::-1, ::-1]) == 255).all()


def test_pixels_are_means_and_the_right_eye_is_mirrored() -> None:
    eyes = np.random.default_rng(0).integers(0, 256, (2, 400, 400), dtype=np.uint8)
    small = pixels(eyes)
    block = eyes[0, 40:44, 80:84].astype(float).mean()
    assert abs(float(small[0, 10, 20]) - block) <= 0.5
    assert np.array_equal(pixels(eyes[:, :, ::-1][::-1]), small[::-1])


def test_exposure_cancels() -> None:
    small = pixels(pair())
    dim = (small * 0.4 + 12).astype(np.uint8)
    assert np.abs(normalised(small)[0] - normalised(dim)[0]).max() < 0.1
    assert np.abs(normalised(np.zeros((2, 100, 100), np.uint8))[0]).max() == 0
