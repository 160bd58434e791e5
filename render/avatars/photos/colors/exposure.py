"""How photographs were exposed, the colour of their light, and the tone of the skin in them.

Logarithms of linear colours. Four things are known, each with its spread: how skins vary over
people, how bright photographs are and how coloured their light, what the whites of the eyes show of
it, and that it is the same face in all photographs. The most likely light and skin follow.
"""

import numpy as np

from render.avatars.maker import Maker
from render.avatars.photos.colors import whites
from render.avatars.photos.colors.light import DARK
from render.avatars.photos.shape.picture import Photo
from render.decoder import identity
from render.decoder.learned import avatar_files
from render.types import Doubles

# Of linear light on a white face in photographs as people take them: logarithm of its brightness,
# and spread; spread of its hue.
BRIGHTNESS, BRIGHTNESS_SPREAD, HUE_SPREAD = np.log(0.7), 0.4, 0.2
SKIN_SPREAD, SKIN_HUE_SPREAD = 0.2, 0.13  # beyond that of the shipped people
SAME_SPREAD = 0.05  # of one face between photographs
ALIKE = np.full((3, 3), 1 / 3)  # the part of a colour that is brightness
APART = np.eye(3) - ALIKE  # and its hue


def estimate(
    maker: Maker, photos: list[Photo], faces: list[Doubles]
) -> tuple[list[Doubles], Doubles]:
    """From the median linear colours of the face [3] in each photograph: the light in each [3], and
    the skin's tone [3], linear albedo."""
    people = np.log([_tone(maker, name) for name in avatar_files.shipped()])
    total = np.zeros((3 + 3 * len(photos),) * 2)  # weights of what is likely, and where that pulls
    pull = np.zeros(len(total))
    spread = np.cov(people.T) + _spread(SKIN_HUE_SPREAD, SKIN_SPREAD)
    total[:3, :3] = np.linalg.inv(spread)
    pull[:3] = total[:3, :3] @ people.mean(0)
    usual = np.linalg.inv(_spread(HUE_SPREAD, BRIGHTNESS_SPREAD))
    for k, (photo, face) in enumerate(zip(photos, faces, strict=True)):
        own = slice(3 + 3 * k, 6 + 3 * k)
        total[own, own] += usual
        pull[own] += usual @ np.full(3, BRIGHTNESS)
        if seen := whites.light(photo):
            shining, hue = seen
            trust = np.linalg.inv(_spread(hue, whites.BRIGHTNESS_SPREAD))
            total[own, own] += trust
            pull[own] += trust @ shining
        both = np.tile(np.eye(3), 2) / SAME_SPREAD  # skin and light make the face's colour
        rows = np.r_[0:3, own]
        total[np.ix_(rows, rows)] += both.T @ both
        pull[rows] += both.T @ np.log(np.maximum(face, DARK)) / SAME_SPREAD
    tone, *lights = np.split(np.linalg.solve(total, pull), 1 + len(photos))
    paler = max(tone.mean() - people.mean(1).max(), 0)  # than the palest
    return [np.exp(light + paler) for light in lights], np.exp(tone - paler)


def _spread(hue: float, brightness: float) -> Doubles:  # [3, 3] covariance
    return hue**2 * APART + brightness**2 * ALIKE


def _tone(maker: Maker, name: str) -> Doubles:  # [3] linear
    return np.median(identity.load(name).albedo[maker.face].astype(np.float64) ** 2, 0)
