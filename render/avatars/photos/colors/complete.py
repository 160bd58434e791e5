"""The skin that no photograph shows: the other side of the face, then how skins vary over heads."""

import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.spatial import KDTree

from render.avatars import scan_texture
from render.avatars.maker import Maker
from render.avatars.scan_texture import SIZE
from render.decoder import identity
from render.types import Doubles, Floats

KNOWN = 0.25  # weight at which a place is known
MIRROR_MM = 4.0
PLAIN = "hugo"  # who has no hair on the scalp; his is a beard
# Where hair may grow, from not at all to fully: from above the brows; at temples, beside the brows
# and above cheeks; behind, and not below.
ABOVE_MM, BESIDE_MM, CHEEKS_MM = (-16.0, 2.0), (-2.0, 5.0), (5.0, 20.0)
BEHIND_MM, NAPE_MM = (35.0, 15.0), (-40.0, -20.0)
BRIGHT = 0.75  # on the face: place in the order of brightness, one without hair there
SMOOTH = 4.0  # texels: typical skin has nobody's freckles
MOST_SPREAD = 0.3  # by which what is unseen differs from the tone of the face; logarithm


def typical(maker: Maker) -> Doubles:  # [T, 3]
    """How skin differs over a head from the tone of its face, without hair: of shipped people."""
    found: list[Doubles] = []
    for name in identity.shipped():
        linear = identity.load(name).albedo.astype(np.float64) ** 2
        found.append(linear / np.median(linear[maker.face], 0))
    ratios = np.array(found)
    bright = np.argsort(ratios.sum(2), axis=0)[int(BRIGHT * (len(found) - 1))]
    ratio = ratios[bright, np.arange(ratios.shape[1])]
    bald = ratios[identity.shipped().index(PLAIN)]
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
    merged: Doubles,  # [T, 3] linear
    total: Doubles,  # [T] how well it is seen
    at: Doubles,  # [T, 3] mm
    pattern: Doubles,  # [T, 3] linear: what is typical
) -> Floats:  # [1024, 2048, 3] stored
    """What is not seen: mirrored, then typical; the edges between are soft and of one tone."""
    known = np.clip(total / KNOWN, 0, 1)
    distance, other = KDTree(at).query(
        at * np.array([-1.0, 1.0, 1.0]), distance_upper_bound=2 * MIRROR_MM
    )
    other = np.where(np.isfinite(distance), other, 0)
    share = known[other] * np.exp(-((distance / MIRROR_MM) ** 2)) * (1 - known)
    both = known + share
    color = (known[:, None] * merged + share[:, None] * merged[other]) / (both[:, None] + 1e-9)
    shape = (SIZE, 2 * SIZE)
    weight = both.reshape(shape)
    even = gaussian_filter(np.log(pattern + 0.002).reshape(*shape, 3), (SMOOTH, SMOOTH, 0))
    pattern = np.exp(even.reshape(-1, 3)) - 0.002
    # Typical skin takes the low tones of what is known beside it.
    ratio = np.log((color + 0.002) / (pattern + 0.002)).reshape(*shape, 3)
    filled = _spread(ratio, weight).clip(-MOST_SPREAD, MOST_SPREAD)
    base = pattern.reshape(*shape, 3) * np.exp(filled)
    soft = gaussian_filter(np.minimum(weight, 1), 3.0)
    soft = np.minimum(soft, weight)[..., None]
    linear = soft * color.reshape(*shape, 3) + (1 - soft) * base
    return scan_texture.enlarged(np.sqrt(np.clip(linear, 0.0, 0.9)))


def _spread(values: Doubles, weight: Doubles) -> Doubles:  # [H, W, 3], [H, W]
    """Known values carried into what is not known: the coarser, the farther away."""
    out, left = np.zeros_like(values), np.zeros_like(weight)
    for sigma in (4.0, 10.0, 24.0, 60.0, 150.0):
        share = gaussian_filter(weight, sigma)
        blurred = gaussian_filter(values * weight[..., None], (sigma, sigma, 0))
        take = np.clip(share * 4, 0, 1) * (1 - left)
        out += take[..., None] * blurred / (share[..., None] + 1e-6)
        left += take
    return out


def anchors(maker: Maker) -> Floats:  # [N, 3] mm
    """Where they are on the mean face."""
    return maker.surface.interpolate @ maker.template[maker.surface.used]
