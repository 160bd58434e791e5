"""The skin around eyes and nostrils: as the cheek in hue, not as a texture's wet corners."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from render.types import Floats

REACH_MM, FADE_MM = 8.0, 2.0  # from the edges of the lids; over what width it ends
RING_MM = 6.0, 14.0  # whose median colour counts
LEAST, MOST = 0.95, 1.05  # of red and blue over green, against the ring's


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
