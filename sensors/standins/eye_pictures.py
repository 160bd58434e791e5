"""Drawn infrared eyes for the stand-in cameras: a pupil that wanders, and sensor noise."""

import math
from io import BytesIO

import numpy as np
from numpy.typing import NDArray


def eye_picture(
    k: int, width: int = 400, height: int = 400, *, noise: bool = True
) -> NDArray[np.uint8]:
    """[height, width]; picture k of an endless film. Equal arguments give equal pictures."""
    y, x = np.mgrid[:height, :width].astype(np.float32)
    scale = min(width, height)
    centre_x = width / 2 + scale * 0.1 * math.sin(k / 11)
    centre_y = height / 2 + scale * 0.06 * math.cos(k / 7)
    radius = np.hypot(x - centre_x, y - centre_y) / scale
    shade = 170 - 90 * np.clip(np.hypot(x - width / 2, y - height / 2) / scale, 0, 1)
    shade = np.where(radius < 0.2, 110, shade)
    shade = np.where(radius < 0.08, 25, shade)
    if noise:
        shade = shade + np.random.default_rng(k).normal(0, 2, shade.shape)
    return np.clip(shade, 0, 255).astype(np.uint8)


def jpeg(
    image: NDArray[np.uint8],  # [H, W]
    quality: int = 80,
) -> bytes:
    from PIL import Image

    data = BytesIO()
    Image.fromarray(image).save(data, "JPEG", quality=quality)
    return data.getvalue()


def film(num: int, width: int = 400, height: int = 400, *, noise: bool = True) -> list[bytes]:
    """`num` pictures as JPEGs."""
    return [jpeg(eye_picture(k, width, height, noise=noise)) for k in range(num)]


def zero_middle(data: bytes) -> bytes:
    """What a camera sends that lost a part of its buffer: valid ends, zeros between."""
    third = len(data) // 3
    return data[:third] + bytes(third) + data[2 * third :]
