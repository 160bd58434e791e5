"""The colours of hair and beard in photographs."""

import numpy as np

from render.avatars.maker import Maker
from render.avatars.photos.colors.complete import anchors
from render.avatars.photos.colors.light import DARK
from render.avatars.photos.colors.projection import towards
from render.avatars.photos.colors.skin import PaintedSkin
from render.avatars.photos.shape.fit import FaceFit
from render.avatars.photos.shape.picture import Photo
from render.decoder import mesh_parts
from render.lighting import exposed
from render.types import Doubles, Floats

CROWN_MM = 118.0  # height above which, in front of the ears, there is no forehead
FACING = 0.3  # least cosine to the viewer
LEAST = 60  # places that tell a colour
BRIGHT, HUE = (0.5, 1.8), 0.3  # of the skin: a bald head, or hair in the colour of skin
GLOSS = 2.0  # brightness of hair in a picture, of its strands
# Hue of hair, logarithm: from grey over brown to this, and somewhat beyond.
GINGER, REDDEST = np.array([1.3, -0.2, -1.1]), 1.1
GREY, BROWN = 0.35, 0.27  # as bright is grey hair; what is darker is rather brown: so much of it


def color(
    maker: Maker,
    photos: list[Photo],
    found: FaceFit,
    rest: Floats,  # [V, 3] mm
    skin: PaintedSkin,
) -> Doubles | None:  # [3] linear albedo
    """None where no hair is seen."""
    head = maker.surface
    top = anchors(maker)
    top = (maker.anchor_kinds == mesh_parts.SKIN) & (top[:, 1] > CROWN_MM) & (top[:, 2] > 0)
    places, normals = (
        (head.interpolate @ values[head.used])[top].astype(np.float64)
        for values in (rest, maker.normals(rest))
    )
    pixels = list[Doubles]()
    for photo, shot, light in zip(photos, found.shots, skin.lights, strict=True):
        height, width = photo.picture.shape[:2]
        x, px = shot.view(places), shot.project(places, (width, height)).astype(int)
        facing = towards(normals @ shot.turn.T, x)
        inside = ((px >= 0) & (px < np.array([width, height]))).all(1)
        column, row = px[inside & (facing > FACING * np.linalg.norm(normals, axis=1))].T
        stored = photo.picture[row, column].astype(np.float32) / np.float32(255)
        pixels.append(exposed(stored) / light)
    shown = np.concatenate(pixels)
    if len(shown) < LEAST:
        return None
    middle = np.median(shown, 0) + DARK
    off = np.log(middle / skin.tone)
    low, high = np.log(BRIGHT)
    if low < off.mean() < high and np.abs(off - off.mean()).max() < HUE:
        return None
    return dye(middle)


def dye(seen: Doubles) -> Doubles:  # [3] linear, in a picture, without the light -> [3] albedo
    """The nearest colour that hair has."""
    bright = np.log(seen).mean()
    red = float(np.clip((np.log(seen) - bright) @ GINGER / (GINGER @ GINGER), 0, REDDEST))
    if bright < np.log(GREY):
        red = max(red, (red + BROWN) / 2)
    return np.exp(bright + red * GINGER) / GLOSS
