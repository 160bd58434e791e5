"""The light in a photograph: soft lamps on all sides of a head that casts shadows on itself.

How bright each lamp is follows from the colours of the face and from how skins typically vary over
it, by least squares without negative lamps; places unlike skin (brows, hair) count less. What light
and lens still leave over wide areas is taken off in part.
"""

import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.optimize import nnls

from render.avatars.maker import Maker
from render.avatars.textures import SIZE
from render.gl.occlusion import sky_directions
from render.types import Doubles, Floats

WRAP = 0.15  # cosine by which light reaches around into the shade of skin
SEEN = 0.3  # weight from which a place tells of the light
MOST_PLACES = 15000  # that are asked
ROUNDS = 6
RIDGE = 1e-3  # of the mean square: lamps share the light where nothing tells them apart
DIM = 0.05  # of the tone, added to what errors are relative to
DARK = 0.003  # added to linear colours before logarithms
HUES = 0.35  # deviation of the logarithm from skin at which a place counts half
# What is left of the light: of its logarithm so much is taken off, over so many texels; less of it
# where it is as large as a beard's.
EVENED, WIDE_TEXELS, BEARDED = 0.7, 16.0, 0.5
LESS = 0.92  # green and blue, of red, at most
DARKER, WARM = 0.7, 0.6  # than skin: there so far towards its hue
SHINES = 0.1  # logarithm
HUE_TEXELS = 3.0  # a millimetre or two
LEAST = 0.02  # weight of places around, from which their mean counts


def lamps(maker: Maker, vertices: Floats, normals: Floats) -> Floats:  # [V, 3] mm, unit -> [N, L]
    """What each lamp, alone and of brightness one, throws on every Gaussian; last, what reaches
    all alike."""
    towards = sky_directions()
    reach = maker.occlusion.from_sides(vertices, normals, towards)
    reach *= np.maximum((normals @ towards.T + WRAP) / (1 + WRAP), 0)
    head = maker.surface
    out = head.interpolate @ reach[head.used].astype(np.float32)
    return np.concatenate([out, np.ones((len(out), 1), np.float32)], 1)


def cast(
    lamps: Floats,  # [N, L]
    color: Doubles,  # [N, 3] linear
    weight: Doubles,  # [N] 0..1, how well it is seen
    typical: Doubles,  # [N, 3] of skin, relative to its tone
) -> Doubles:  # [N, 3] linear
    """What all lamps together throw on skin of the photographed tone."""
    rows = np.flatnonzero(weight > SEEN)
    if len(rows) < 2 * lamps.shape[1]:
        return np.tile(
            np.median(color[weight > 0], 0) if weight.any() else np.ones(3), (len(lamps), 1)
        )
    rows = rows[:: max(1, len(rows) // MOST_PLACES)]
    own, color, typical = lamps[rows].astype(np.float64), color[rows], typical[rows]
    middle = np.maximum(np.median(color, 0), DARK)  # red light has no blue
    brightness, expected = np.zeros((lamps.shape[1], 3)), middle * typical
    for _ in range(ROUNDS):
        trust = weight[rows] / (1 + (unlikeness(color, expected) / HUES) ** 2) ** 2
        scale = np.sqrt(trust)[:, None] / (expected + DIM * middle)
        for k in range(3):
            design = own * (typical[:, k] * scale[:, k])[:, None]
            brightness[:, k] = _solved(design, color[:, k] * scale[:, k])
        expected = (own @ brightness) * typical
    return lamps @ brightness


def _solved(design: Doubles, wanted: Doubles) -> Doubles:  # [n, L], [n] -> [L] >= 0
    square = design.T @ design
    square += RIDGE * np.trace(square) / len(square) * np.eye(len(square))
    root = np.linalg.cholesky(square)
    return nnls(root.T, np.linalg.solve(root, design.T @ wanted))[0]


def unlikeness(color: Doubles, skin: Doubles) -> Doubles:  # [n, 3], [3] or [n, 3] -> [n]
    """The largest deviation of a channel's logarithm from skin."""
    return np.abs(np.log((color + DARK) / (skin + DARK))).max(1)


def likeness(color: Doubles, skin: Doubles) -> Doubles:  # [n, 3], [3] or [n, 3] -> [n] 0..1
    """1 on skin, little on hair."""
    return 1 / (1 + (unlikeness(color, skin) / HUES) ** 4)


def around(
    values: Doubles,  # [H, W, C]
    trust: Doubles,  # [H, W, 1]
    texels: float,
    otherwise: Doubles,  # [H, W, C] or [C]
) -> Doubles:  # [H, W, C]
    """Means of what is trusted within some texels; where nothing is, what they are otherwise."""
    blur = (texels, texels, 0.0)
    sums = gaussian_filter(values * trust, blur) + LEAST * otherwise
    return sums / (gaussian_filter(trust, blur) + LEAST)


def evened(color: Doubles, weight: Doubles, skin: Doubles) -> Doubles:  # [T, 3], [T], [T, 3]
    """Colours less what they differ over wide areas from typical `skin` [T, 3], in part."""
    off, trust = np.log((color + DARK) / (skin + DARK)), weight * likeness(color, skin)
    picture, share = off.reshape(SIZE, 2 * SIZE, 3), trust.reshape(SIZE, 2 * SIZE, 1)
    left = around(picture, share, WIDE_TEXELS, np.zeros(3)).reshape(-1, 3)
    left /= 1 + (np.abs(left).max(1, keepdims=True) / BEARDED) ** 4
    return color * np.exp(-EVENED * left)


def matte(color: Doubles, skin: Doubles) -> Doubles:  # [T, 3] linear
    """With half of what shines: is brighter than typical `skin` [T, 3]."""
    over = np.log((color.mean(1) + DARK) / (skin.mean(1) + DARK)) - SHINES
    return color * np.exp(-0.5 * np.maximum(over, 0))[:, None]


def soft_hues(color: Doubles, trust: Doubles, skin: Doubles) -> Doubles:  # [T, 3], [T], [T, 3]
    """With hues as of the places around that are trusted, typical where none are: a camera keeps
    those coarser than brightness, and none where it is dazzled."""
    own, usual = (np.log(some + DARK).reshape(SIZE, 2 * SIZE, 3) for some in (color, skin))
    bright = own.mean(2, keepdims=True)
    own, usual = own - bright, usual - usual.mean(2, keepdims=True)
    share = trust.reshape(SIZE, 2 * SIZE, 1)
    hues = around(own, share, HUE_TEXELS, usual)
    return np.maximum(np.exp(bright + hues) - DARK, 0).reshape(-1, 3)


def natural(color: Doubles, tone: Doubles) -> Doubles:  # [n, 3], [3] linear
    """Neither skin nor hair is as green or blue as it is red; what is dark in a photograph often
    is, and beside skin looks so even where it is grey."""
    dark = (DARKER - color.mean(1) / tone.mean()) / DARKER
    most = LESS * (tone / tone[0]) ** (WARM * np.clip(dark, 0, 1)[:, None])
    most[:, 0] = 1
    return np.minimum(color, color[:, :1] * most)
