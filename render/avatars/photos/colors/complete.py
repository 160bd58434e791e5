"""The skin that no photograph shows: the other side of the face, then how skins vary over heads."""

import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.spatial import KDTree
from scipy.spatial.distance import cdist

from render.avatars import scan_texture
from render.avatars.maker import Maker
from render.avatars.photos.colors.light import DARK
from render.avatars.textures import SIZE
from render.decoder import identity
from render.decoder.learned import avatar_files
from render.types import Doubles, Floats, Ints

KNOWN = 0.25  # weight at which a place is known
MIRROR_MM = 4.0
PLAIN = "hugo"  # who has no hair on the scalp; his is a beard
# Where hair may grow, from not at all to fully: from above the brows; at temples, beside the brows
# and above cheeks; behind, and not below.
ABOVE_MM, BESIDE_MM, CHEEKS_MM = (-16.0, 2.0), (-2.0, 5.0), (5.0, 20.0)
BEHIND_MM, NAPE_MM = (35.0, 15.0), (-40.0, -20.0)
BRIGHT = 0.75  # on the face: place in the order of brightness, one without hair there
SMOOTH = 4.0  # texels: typical skin has nobody's freckles
GLARES, SHINES = (0.25, 0.6), (0.1, 0.4)  # logarithm of blue: over the other side, over skin
SOURCES, NEAR_MM = 1500, 4.0  # places that tell of the unseen; up to there all count alike
MOST_SPREAD = 0.3  # by which what is unseen differs from the tone of the face; logarithm


def typical(maker: Maker) -> Doubles:  # [T, 3]
    """How skin differs over a head from the tone of its face, without hair: of shipped people."""
    found: list[Doubles] = []
    for name in avatar_files.shipped():
        linear = identity.load(name).albedo.astype(np.float64) ** 2
        found.append(linear / np.median(linear[maker.face], 0))
    ratios = np.array(found)
    bright = np.argsort(ratios.sum(2), axis=0)[int(BRIGHT * (len(found) - 1))]
    ratio = ratios[bright, np.arange(ratios.shape[1])]
    bald = ratios[avatar_files.shipped().index(PLAIN)]
    wide, high = np.abs(maker.template[maker.regions["brows"], :2]).max(0)
    aside, up, ahead = anchors(maker).T
    temples = ramp(np.abs(aside) - wide, *BESIDE_MM) * ramp(up, *CHEEKS_MM)
    behind = ramp(ahead, *BEHIND_MM) * ramp(up, *NAPE_MM)
    scalp = np.maximum(np.maximum(ramp(up - high, *ABOVE_MM), temples), behind)[:, None]
    ratio = scalp * bald + (1 - scalp) * ratio
    return scan_texture.over_atlas(maker, ratio.astype(np.float32)).astype(np.float64)


def ramp(values: Doubles, start: float, end: float) -> Doubles:  # [n] -> [n] 0..1
    return np.clip((values - start) / (end - start), 0, 1)


def complete(
    maker: Maker,
    merged: Doubles,  # [T, 3] linear
    total: Doubles,  # [T] how well it is seen
    at: Doubles,  # [T, 3] mm on the mean face
    pattern: Doubles,  # [T, 3] linear: what is typical
) -> Floats:  # [1024, 2048, 3] stored
    """What is not seen: mirrored, then typical; the edges between are soft and of one tone."""
    known = np.clip(total / KNOWN, 0, 1)
    distance, other = KDTree(at).query(
        at * np.array([-1.0, 1.0, 1.0]), distance_upper_bound=2 * MIRROR_MM
    )
    other = np.where(np.isfinite(distance), other, 0)
    known *= believed(merged, known, other, pattern)
    share = known[other] * np.exp(-((distance / MIRROR_MM) ** 2)) * (1 - known)
    both = known + share
    color = (known[:, None] * merged + share[:, None] * merged[other]) / (both[:, None] + 1e-9)
    shape = (SIZE, 2 * SIZE)
    even = gaussian_filter(np.log(pattern + DARK).reshape(*shape, 3), (SMOOTH, SMOOTH, 0))
    even = even.reshape(-1, 3)
    # Typical skin takes the low tones of what is known beside it.
    near = carried(at, np.log(color + DARK) - even, both, anchors(maker).astype(np.float64))
    filled = scan_texture.over_atlas(maker, near.clip(-MOST_SPREAD, MOST_SPREAD).astype("f4"))
    base = np.exp(even + filled) - DARK
    weight = both.reshape(shape)
    soft = gaussian_filter(np.minimum(weight, 1), 3.0)
    soft = np.minimum(soft, weight).reshape(-1, 1)
    linear = (soft * color + (1 - soft) * base).reshape(*shape, 3)
    return scan_texture.enlarged(np.sqrt(np.clip(linear, 0.0, 0.9)))


def believed(
    color: Doubles,  # [T, 3] linear
    known: Doubles,  # [T] 0..1
    other: Ints,  # [T] the same place on the other side
    typical: Doubles,  # [T, 3] linear
) -> Doubles:  # [T] 0..1
    """Not what is far brighter than both the other side and typical skin: that glares."""
    # Skin has little blue, what glares has most of it.
    blue, usual = np.log(color[:, 2] + DARK), np.log(typical[:, 2] + DARK)
    glare = ramp(blue - blue[other], *GLARES) * ramp(blue - usual, *SHINES)
    return 1 - glare * known[other]


def carried(
    at: Doubles,  # [T, 3] mm
    values: Doubles,  # [T, C]
    weight: Doubles,  # [T] 0..1, known
    places: Doubles,  # [n, 3] mm
) -> Doubles:  # [n, C]
    """Known values carried to places where they are not: over the head, whatever the atlas cuts;
    the coarser, the farther away."""
    rows = np.flatnonzero(weight > 0.5)
    if not len(rows):
        return np.zeros((len(places), values.shape[1]))
    rows = rows[:: max(1, len(rows) // SOURCES)]
    out = np.empty((len(places), values.shape[1]))
    for start in range(0, len(places), 4096):
        part = slice(start, start + 4096)
        away = cdist(places[part], at[rows], "sqeuclidean") + NEAR_MM**2
        share = 1 / (away * np.sqrt(away))
        out[part] = share @ values[rows] / share.sum(1, keepdims=True)
    return out


def anchors(maker: Maker) -> Floats:  # [N, 3] mm
    """Where they are on the mean face."""
    return maker.surface.interpolate @ maker.template[maker.surface.used]
