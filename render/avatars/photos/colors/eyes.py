"""Which of the known eye colours photographs show, by the ring of the iris around the pupil."""

import numpy as np

from render.avatars.photos.colors import whites
from render.avatars.photos.colors.light import DARK
from render.avatars.photos.shape.detector import EYES
from render.avatars.photos.shape.picture import Photo
from render.types import Doubles

RING = (0.4, 0.85)  # of the iris' radius: neither pupil nor edge
HIGHLIGHT = 75  # percentile of brightness from which a lamp is mirrored
LEAST = 30  # pixels that tell a colour
# Mean of the logarithms, and what red and green are above it, in white light of brightness one.
KNOWN = {
    "blue": (-1.6, -0.14, 0.0),
    "grey": (-1.75, 0.04, 0.02),
    "green": (-2.0, 0.23, 0.23),
    "brownlight": (-2.2, 0.63, 0.08),
    "brown": (-2.8, 0.68, 0.0),
}
SPREAD = np.array([0.6, 0.2, 0.12])
USUAL, MORE = "brown", 2.0  # most people's, and by how much that is likelier: squared deviations


def color(photos: list[Photo], lights: list[Doubles]) -> str:  # [3] each
    """The likeliest; brown where the eyes are too small or shut."""
    pixels = [_ring(p) / light for p, light in zip(photos, lights, strict=True)]
    seen = np.concatenate(pixels)
    if len(seen) < LEAST:
        return USUAL
    tone = np.log(np.median(seen, 0) + DARK)
    found = np.array([tone.mean(), *(tone - tone.mean())[:2]])
    off = {
        name: float((((found - np.array(at)) / SPREAD) ** 2).sum()) for name, at in KNOWN.items()
    }
    off[USUAL] -= MORE
    return min(off, key=lambda name: off[name])


def _ring(photo: Photo) -> Doubles:  # [n, 3] linear
    out = [np.zeros((0, 3))]
    for outline, iris in EYES:
        pixels, off = whites.in_eye(photo, outline, iris, edge_px=1)
        pixels = pixels[(off > RING[0]) & (off < RING[1])]
        if len(pixels):
            bright = pixels.sum(1)
            out.append(pixels[bright <= np.percentile(bright, HIGHLIGHT)])
    return np.concatenate(out)
