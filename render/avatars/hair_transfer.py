"""Hair of one person on the head of another."""

from dataclasses import replace

import numpy as np
from scipy.spatial import KDTree

from render.decoder.identity import Identity
from render.strands import Hair

NEIGHBOURS = 24
SOFT_MM = 18.0  # hair far from the skin follows a wide part of it
SCALP_MM = 60.0  # skin above this height carries the hair


def transfer(lender: Identity, wearer: Identity) -> Hair:
    """Move the lender's hair with the scalp: each strand follows the skin nearest to it."""
    hair, skin = lender.hair, lender.geometry[:11248]
    if len(hair) == 0:
        return hair
    scalp = np.flatnonzero((skin[:, 1] > SCALP_MM) | (skin[:, 2] < 10))
    distance, near = KDTree(skin[scalp]).query(hair.means, k=NEIGHBOURS)
    weight = np.exp(-(((distance - distance[:, :1]) / SOFT_MM) ** 2))
    weight /= weight.sum(1, keepdims=True)
    moved = (wearer.geometry - lender.geometry)[scalp][near]
    means = hair.means + (moved * weight[..., None]).sum(1)
    return replace(hair, means=means.astype(np.float32))
