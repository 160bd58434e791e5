"""Hair of one person on the head of another."""

from dataclasses import replace

import numpy as np
from scipy.spatial import KDTree

from render.avatars import hairline
from render.avatars.maker import Maker
from render.decoder.identity import Identity
from render.decoder.mesh_parts import SKIN_VERTICES
from render.strands import Hair, away

NEIGHBOURS = 24
SOFT_MM = 18.0  # hair far from the skin follows a wide part of it
HIGH_MM = 80.0  # hair so high lies over the skin below it
DENSE = 0.9  # of the largest cover of skin: from there on it has the colour of roots
DARKER = 0.25  # of its area that is: at the edges skin shows through
RADIUS_MM = np.float32(100.0)  # of a head
SCALP_MM = 60.0  # skin above this height carries the hair


def worn(maker: Maker, who: Identity, lender: Identity) -> Identity:
    """With the lender's hair, and what it does to the skin below and beside it."""
    hair = transfer(lender, who)
    if len(hair) == 0:
        return who
    head, used = maker.surface, who.geometry[maker.surface.used]
    points, normals = head.interpolate @ used, maker.normals(who.geometry)[:SKIN_VERTICES]
    low, over = (
        hairline.near(
            points, hairline.feet(who.geometry[:SKIN_VERTICES], normals, hair.means, highest)
        )
        for highest in (hairline.LOW_MM, HIGH_MM)
    )
    out, up = (RADIUS_MM * away(at) for at in (points, hair.means))
    over = np.maximum(over, hairline.near(out, up))  # high above it feet are far apart
    dense = low >= DENSE * low.max()
    area = np.repeat(head.scales[dense, None] ** 2, 3, 1)  # Gaussians crowd where a face begins
    root = np.quantile(lender.albedo[dense], DARKER, 0, weights=area, method="inverted_cdf")
    unlike = np.linalg.norm(lender.albedo - root, axis=1)
    skin = np.linalg.norm(np.median(lender.albedo[maker.face], 0) - root)
    dyed = np.clip(2 - 3 * unlike / np.maximum(skin, 0.05), 0, 1)
    cover = np.maximum(hairline.near(points, hair.means), dyed * over)[:, None]
    visible = hairline.shaded(who.visibility, used, hair.means)
    visible = hairline.lit(visible, used, hair.means, hair.seen)
    return replace(
        who,
        hair=hair,
        albedo=(who.albedo + hairline.ROOTS * cover * (root - who.albedo)).astype(np.float32),
        gloss=(who.gloss * (1 - hairline.MATTE * over)).astype(np.float32),
        visibility=hairline.cast(visible, used, hair.means),
    )


def transfer(lender: Identity, wearer: Identity) -> Hair:
    """Move the lender's hair with the scalp: each strand follows the skin nearest to it."""
    hair, skin = lender.hair, lender.geometry[:SKIN_VERTICES]
    if len(hair) == 0:
        return hair
    scalp = np.flatnonzero((skin[:, 1] > SCALP_MM) | (skin[:, 2] < 10))
    distance, near = KDTree(skin[scalp]).query(hair.means, k=NEIGHBOURS)
    weight = np.exp(-(((distance - distance[:, :1]) / SOFT_MM) ** 2))
    weight /= weight.sum(1, keepdims=True)
    moved = (wearer.geometry - lender.geometry)[scalp][near]
    means = hair.means + (moved * weight[..., None]).sum(1)
    return replace(hair, means=means.astype(np.float32))
