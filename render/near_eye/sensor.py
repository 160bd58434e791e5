"""From light to grey levels: exposure, lens, noise and reflections of a small infrared camera."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve1d, gaussian_filter

from render.near_eye.look import Look
from render.types import Floats

FULL_PX = 400  # the size to which a look's blur and noise belong


def expose(
    light: Floats,  # [H, W] linear, 0..
    look: Look,
    rng: np.random.Generator,
) -> NDArray[np.uint8]:  # [H, W]
    """One picture as the camera delivers it; smaller ones are like the means of a full one."""
    scale = len(light) / FULL_PX
    image = np.maximum(light, np.float32(0)) + np.float32(0.2 * look.backdrop)
    if look.reflections:
        image = image + _reflections(image, look, rng)
    # bright glints bloom a little before they are cut off
    image = gaussian_filter(np.minimum(image, 6.0), look.blur_px * scale, truncate=3)
    if look.motion_px:
        size = max(2, round(look.motion_px * scale))
        image = convolve1d(image, np.full(size, 1 / size, np.float32), axis=int(rng.integers(2)))
    image *= _vignette(image.shape[0], look.vignette)
    typical = float(np.mean(image[::4, ::4])) + 1e-6
    steps = image * (1023 / 4 * look.exposure / 255 / typical)
    response = 255 * np.linspace(0, 4, 1024, dtype=np.float32) ** look.gamma
    grey = response[np.minimum(steps, 1023).astype(np.int16)]
    spread = look.noise * scale * (0.5 + 0.5 * np.sqrt(np.minimum(response, 255) / 128))
    start = int(rng.integers(len(_NOISE) - image.size))
    noise = _NOISE[start : start + image.size].reshape(image.shape)
    grey += spread[np.minimum(steps, 1023).astype(np.int16)] * noise + 0.5
    return np.clip(grey, 0, 255, out=grey).astype(np.uint8)


@lru_cache(maxsize=64)
def _vignette(size: int, depth: float) -> Floats:
    y, x = np.ogrid[-1 : 1 : size * 1j, -1 : 1 : size * 1j]
    return (1 - depth * np.minimum(x**2 + y**2, 1.7) * 0.6).astype(np.float32)


# Cut at a random place for each picture: drawing noise afresh would cost a third of its time.
_NOISE = np.random.default_rng(0).standard_normal(1_000_003, np.float32)


def _reflections(image: Floats, look: Look, rng: np.random.Generator) -> Floats:
    """Soft images of lamps and windows in the glasses, faint to bright."""
    height, width = image.shape
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    total = np.zeros_like(image)
    for _ in range(look.reflections):
        cx, cy = rng.uniform(0, width), rng.uniform(0, height)
        a, b, turn = rng.uniform(6, 45), rng.uniform(4, 20), rng.uniform(0, 3.2)
        a, b = a * height / FULL_PX, b * height / FULL_PX
        u = (x - cx) * np.cos(turn) + (y - cy) * np.sin(turn)
        v = (y - cy) * np.cos(turn) - (x - cx) * np.sin(turn)
        edge = (np.abs(u / a) ** 4 + np.abs(v / b) ** 4) ** 0.25
        total += rng.uniform(0.05, 0.6) * np.clip((1.3 - edge) / 0.8, 0, 1)
    return total * float(image.mean())
