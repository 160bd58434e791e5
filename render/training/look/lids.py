"""The skin around eyes and nostrils: without what a texture painted there, as the cheek in hue."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from render.training.look.places import Places, soft
from render.types import Floats

# From the edges of the lids: where a texture has corners, crease and lashes of its own, where not.
PAINTED_MM = 7.5, 13.0
AROUND_MM, AROUND = 12.0, 28  # from where skin fills that in; texels over which it is evened
LID, LID_MM = np.array([0.90, 0.81, 0.80], np.float32), 9.0  # colour, in that of this skin
RIM_MM = 0.9  # of an edge of a lid, how wide
ROOTS = np.array([0.62, 0.56, 0.55], np.float32)  # of lashes: colour, in that of the skin
WET = np.array([0.97, 0.86, 0.85], np.float32)
REACH_MM, FADE_MM = 8.0, 2.0  # from the edges of the lids; over what width it ends
RING_MM = 6.0, 14.0  # whose median colour counts
LEAST, MOST = 0.95, 1.05  # of red and blue over green, against the ring's


def plain(tone: Floats, places: Places) -> Floats:  # [SIZE, SIZE, 3] linear
    """A skin whose lids are smooth, in the colour of what lies around them: stretched over a shut
    eye, what is painted there looks like crusts."""
    off = places.off_eyes
    weight = (places.points.any(2) * (off > AROUND_MM) + 1e-5).astype(np.float32)
    around = soft(tone * weight[..., None], AROUND) / soft(weight, AROUND)[..., None]
    inside = np.clip((LID_MM - off) / LID_MM, 0, 1)[..., None]
    near, far = PAINTED_MM
    share = np.clip((far - off) / (far - near), 0, 1)[..., None]
    lid = around * (1 - inside * (1 - LID))
    return (tone + share * share * (3 - 2 * share) * (lid - tone)).astype(np.float32)


def rimmed(
    albedo: Floats,  # [n, 3] stored
    points: Floats,  # [n, 3] mm
    skin: NDArray[np.bool_],  # [n]
    edges: list[tuple[Floats, Floats]],  # [m, 3] mm each: of the upper and lower lid of an eye
) -> Floats:  # [n, 3]
    """The albedo with a wet edge of the lower lid, and roots of lashes along the upper one."""
    out = albedo.astype(np.float32).copy()
    for edge, color in (pair for sides in edges for pair in zip(sides, (ROOTS, WET), strict=True)):
        apart = np.asarray(KDTree(edge).query(points)[0])
        share = skin * np.exp(-((apart / RIM_MM) ** 2))
        out *= 1 - share[:, None] * (1 - color)
    return out.astype(np.float32)


def calmed(
    albedo: Floats,  # [n, 3] stored
    points: Floats,  # [n, 3] mm
    skin: NDArray[np.bool_],  # [n] and no eyeball
    edges: list[Floats],  # [m, 3] mm each: the edges of an eye's lids, the nostrils
) -> Floats:  # [n, 3]
    """The albedo with the hue of the skin around: texture maps have red and yellow blots in the
    corners of the eyes. Brightness stays."""
    out = albedo.astype(np.float32).copy()
    for edge in edges:
        apart = np.asarray(KDTree(edge).query(points)[0])
        ring = skin & (apart > RING_MM[0]) & (apart < RING_MM[1])
        near = skin & (apart < REACH_MM)
        usual, before = np.median(albedo[ring], 0), out[near]
        hue = np.clip(
            before / np.maximum(before[:, 1:2], 1e-3),
            LEAST * usual / usual[1],
            MOST * usual / usual[1],
        )
        hue[:, 1] = 1
        after = hue * (before.sum(1) / hue.sum(1))[:, None]
        out[near] += np.clip((REACH_MM - apart[near]) / FADE_MM, 0, 1)[:, None] * (after - before)
    return out
