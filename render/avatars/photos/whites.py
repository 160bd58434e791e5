"""The colour of the light in a photograph, by the whites of the eyes."""

import numpy as np
from PIL import Image, ImageDraw
from scipy.ndimage import binary_erosion

from render.avatars.photos.detector import LEFT_EYE, LEFT_IRIS, RIGHT_EYE, RIGHT_IRIS
from render.avatars.photos.picture import Photo
from render.lighting import LUMINANCE, exposed
from render.types import Doubles

IRIS = 1.15  # radii of an iris that are not white
EDGE_PX = 2  # from the lids
LEAST = 30  # pixels that tell a colour
BRIGHT = (50, 90)  # percentiles: neither veins and shade nor a highlight
WHITE = np.array([1.2, 1.0, 0.9])  # of an eye, relative to green: between drawn and real ones
TRUST, MOST = 0.8, 1.7  # power of what is found; its limit


def light(photo: Photo) -> Doubles:  # [3]
    """Of brightness one; 1 each where the eyes tell nothing."""
    eyes = (LEFT_EYE, LEFT_IRIS), (RIGHT_EYE, RIGHT_IRIS)
    pixels = np.concatenate([_white(photo, *eye) for eye in eyes])
    if len(pixels) < LEAST:
        return np.ones(3)
    brightness = pixels.sum(1)
    low, high = np.percentile(brightness, BRIGHT)
    tone = np.median(pixels[(brightness >= low) & (brightness <= high)], 0)
    ratio = tone / np.maximum(tone[1], 1e-3) / WHITE
    found = np.clip(ratio**TRUST, 1 / MOST, MOST)
    return found / (found @ LUMINANCE)


def _white(photo: Photo, outline: tuple[int, ...], iris: int) -> Doubles:  # [n, 3] linear
    points = photo.points[list(outline)]
    left, top = np.floor(points.min(0)).astype(int) - 1
    right, bottom = np.ceil(points.max(0)).astype(int) + 2
    left, top = max(left, 0), max(top, 0)
    part = photo.picture[top:bottom, left:right]
    if not part.size:
        return np.zeros((0, 3))
    image = Image.new("L", part.shape[1::-1])
    ImageDraw.Draw(image).polygon([(x - left, y - top) for x, y in points], fill=1)
    inside = np.asarray(binary_erosion(np.asarray(image) > 0, iterations=EDGE_PX), bool)
    middle = photo.points[iris]
    radius = np.linalg.norm(photo.points[iris + 1 : iris + 5] - middle, axis=1).mean()
    row, column = np.indices(inside.shape)
    off = np.hypot(column + 0.5 + left - middle[0], row + 0.5 + top - middle[1])
    white = inside & (off > IRIS * radius)
    return exposed(part[white].astype(np.float32) / np.float32(255)).astype(np.float64)
