"""The light in a photograph, by the whites of the eyes."""

import numpy as np
from PIL import Image, ImageDraw
from scipy.ndimage import binary_erosion

from render.avatars.photos.colors.light import DARK
from render.avatars.photos.shape.detector import EYES
from render.avatars.photos.shape.picture import Photo
from render.lighting import exposed
from render.types import Doubles

IRIS = 1.15  # radii of an iris that are not white
EDGE_PX = 2  # from the lids
LEAST = 30  # pixels that tell a colour
BRIGHT = (50, 90)  # percentiles: neither veins and shade nor a highlight
# Of an eye: logarithms of what it reflects, in the shade of its lids. How far hue and brightness
# may be off, over people; the hue of few pixels more, which lids and veins blur.
WHITE = np.array([-0.94, -1.05, -1.16])
HUE_SPREAD, BRIGHTNESS_SPREAD, OF_PIXELS = 0.1, 0.5, 2.5


def light(photo: Photo) -> tuple[Doubles, float] | None:
    """Logarithms [3], and the spread of their hue; None where eyes are shut, or small."""
    parts = [in_eye(photo, *eye, EDGE_PX) for eye in EYES]
    pixels = np.concatenate([colors[off > IRIS] for colors, off in parts])
    count = len(pixels)
    if count < LEAST:
        return None
    brightness = pixels.sum(1)
    low, high = np.percentile(brightness, BRIGHT)
    pixels = pixels[(brightness >= low) & (brightness <= high)] + DARK
    redness = pixels[:, 0] / pixels[:, 1]
    seen = np.log(np.median(pixels[redness <= np.median(redness)], 0))
    return seen - WHITE, float(np.hypot(HUE_SPREAD, OF_PIXELS / np.sqrt(count)))


def in_eye(
    photo: Photo, outline: tuple[int, ...], iris: int, edge_px: int
) -> tuple[Doubles, Doubles]:
    """Linear pixels [n, 3] between the lids, so far from them, and how far they are from the middle
    of the iris [n], in its radii."""
    points = photo.points[list(outline)]
    left, top = np.floor(points.min(0)).astype(int) - 1
    right, bottom = np.ceil(points.max(0)).astype(int) + 2
    left, top = max(left, 0), max(top, 0)
    part = photo.picture[top:bottom, left:right]
    if not part.size:
        return np.zeros((0, 3)), np.zeros(0)
    image = Image.new("L", part.shape[1::-1])
    ImageDraw.Draw(image).polygon([(x - left, y - top) for x, y in points], fill=1)
    inside = np.asarray(binary_erosion(np.asarray(image) > 0, iterations=edge_px), bool)
    middle = photo.points[iris]
    radius = np.linalg.norm(photo.points[iris + 1 : iris + 5] - middle, axis=1).mean()
    row, column = np.nonzero(inside)
    off = np.hypot(column + 0.5 + left - middle[0], row + 0.5 + top - middle[1]) / radius
    pixels = exposed(part[inside].astype(np.float32) / np.float32(255))
    return pixels.astype(np.float64), off
