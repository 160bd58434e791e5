"""What photographs of a face do not show: a shirt, and roots under hair, as a shipped person's.

A shirt is thicker than the skin and has a collar and a hem, whose pieces stand on the skin as a
beard's strands do; so the lender's fit anybody.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from render import clothes
from render.avatars.maker import Maker
from render.avatars.photos.colors.complete import NAPE_MM, anchors, ramp
from render.avatars.photos.colors.light import DARK
from render.decoder import mesh_parts
from render.decoder.beard import Beard, joined
from render.decoder.identity import Identity
from render.lighting import LUMINANCE
from render.types import Doubles, Floats

ROOTS = (0.75, 0.45)  # brightness of a scalp, of its owner's face: from skin to roots
LIGHT = 0.55  # brightness of hair, of its owner's face, from which its roots are not dark
SCALP_MM, BACK_MM = (60.0, 78.0), (20.0, 5.0)  # above, or behind, are roots
UNDER_MM = (5.0, 1.5)  # from a beard's strands to skin: from not at all to fully under it
LIFT_MM = 1.0  # by which pieces of a shirt stand farther out: else a seam drowns in other necks
COLLAR_MM = 7.0  # above the neckline: up to there are pieces of a shirt, from there on strands


def padded(maker: Maker, geometry: Floats) -> Floats:  # [V, 3] mm
    """As thick as a shirt is where one is worn."""
    skin = maker.surface_kinds == mesh_parts.SKIN
    return clothes.worn(maker.template, geometry, maker.normals(geometry), skin)


def dressed(maker: Maker, who: Identity, lender: Identity) -> Identity:
    """With the lender's shirt, and the roots of the hair that is worn."""
    head = maker.surface
    skin = (maker.surface_kinds[head.used] == mesh_parts.SKIN).astype(np.float32)
    cloth = clothes.cover(anchors(maker), head.interpolate @ skin)
    share = np.maximum(cloth, roots(maker, lender)) if len(lender.hair) else cloth
    albedo = who.albedo + share[:, None] * (lender.albedo - who.albedo)
    shirt = lender.beard.take(above_neckline(maker, lender.beard) < COLLAR_MM)
    shirt = replace(shirt, offsets=shirt.offsets + np.array([0, 0, LIFT_MM], np.float32))
    return replace(
        who,
        albedo=albedo.astype(np.float32),
        gloss=(who.gloss * (1 - cloth)).astype(np.float32),
        visibility=clothes.shaded(who.visibility, maker.template[head.used]),
        beard=joined([who.beard, shirt]),
    )


def dyed(maker: Maker, lender: Identity, wanted: Doubles) -> Identity:  # [3] linear albedo
    """With hair, and roots on the scalp, of this colour."""
    if not len(lender.hair):
        return lender
    own = np.median(lender.hair.albedo.astype(np.float64) ** 2, 0)
    strands = np.clip(lender.hair.albedo * _gain(own, wanted), 0, 1).astype(np.float32)
    who = replace(lender, hair=replace(lender.hair, albedo=strands))
    share = roots(maker, lender)
    if not share.any():
        return who
    least_skin = share**4  # where hardly anything but roots is seen
    root = np.average(lender.albedo.astype(np.float64) ** 2, 0, least_skin)
    gain = _gain(root, wanted * (root @ LUMINANCE) / (own @ LUMINANCE))  # as dark beside strands
    scalp = np.clip(lender.albedo * (1 + share[:, None] * (gain - 1)), 0, 1)
    return replace(who, albedo=scalp.astype(np.float32))


def _gain(own: Doubles, wanted: Doubles) -> Doubles:  # [3], [3] linear -> [3] of stored colours
    return np.sqrt((wanted + DARK) / (own + DARK))


def bearded(
    maker: Maker,
    who: Identity,
    lender: Identity,
    wanted: Doubles | None = None,  # [3] linear albedo of a beard that the skin shows already
) -> Identity:
    """With the lender's beard, in the wanted colour; else in its own, and the skin under it as
    dark. Without brows, lashes and shirt."""
    beard, at = beard_of(maker, lender)
    if not len(beard):
        return who
    if wanted is not None:
        bright = (beard.albedo.astype(np.float64) ** 2).mean(1, keepdims=True)
        dyed = np.clip(np.sqrt(wanted * bright / np.median(bright)), 0, 1)
        beard = replace(beard, albedo=dyed.astype(np.float32))
        return replace(who, beard=joined([who.beard, beard]))
    dye = np.minimum(lender.albedo / np.median(lender.albedo[maker.face], 0), 1)
    albedo = who.albedo * (1 - under(maker, at)[:, None] * (1 - dye))
    return replace(who, albedo=albedo.astype(np.float32), beard=joined([who.beard, beard]))


def beard_of(maker: Maker, lender: Identity) -> tuple[Beard, Floats]:
    """Its strands and where they stand [B, 3] mm, without brows, lashes and shirt."""
    at = standing(maker, lender.beard)
    below_eyes = at[:, 1] < maker.template[maker.regions["eyelids"], 1].min()
    grown = below_eyes & (clothes.height(at) >= COLLAR_MM)
    return lender.beard.take(grown), at[grown]


def under(maker: Maker, at: Floats) -> Floats:  # [B, 3] mm -> [N] 0..1
    """How far each Gaussian is skin between the strands of a beard."""
    away, _ = KDTree(at).query(anchors(maker))
    skin = maker.anchor_kinds == mesh_parts.SKIN
    return ramp(away, *UNDER_MM) * skin * (1 - maker.surface.share_on(maker.regions["lips"]))


def standing(maker: Maker, strands: Beard) -> NDArray[np.float32]:  # [B, 3] mm
    """Where strands stand on the mean face."""
    return np.einsum("bij,bi->bj", maker.template[strands.corners], strands.shares)


def above_neckline(maker: Maker, strands: Beard) -> NDArray[np.float32]:  # [B] mm
    """How high strands stand."""
    return clothes.height(standing(maker, strands))


def roots(maker: Maker, lender: Identity) -> Floats:  # [N] 0..1
    """Where the lender's scalp has the colour of hair: where it is dark, and under light hair where
    it is more like the middle of the scalp than like the face."""
    light = lender.albedo @ LUMINANCE
    tone = float(np.median(light[maker.face]))
    _, up, ahead = anchors(maker).T
    behind = ramp(ahead, *BACK_MM) * ramp(up, *NAPE_MM)
    hairy = np.maximum(ramp(up, *SCALP_MM), behind) * (maker.anchor_kinds == mesh_parts.SKIN)
    like = (ROOTS[0] - light / tone) / (ROOTS[0] - ROOTS[1])
    if np.median(lender.hair.albedo @ LUMINANCE) > LIGHT * tone:
        root = np.median(lender.albedo[hairy == 1], 0)
        skin = np.median(lender.albedo[maker.face], 0)
        unlike = np.linalg.norm(lender.albedo - root, axis=1) / np.linalg.norm(skin - root)
        like = np.maximum(like, 2 - 3 * unlike)
    return (np.clip(like, 0, 1) * hairy).astype(np.float32)
