"""What photographs of a face do not show: a shirt, and roots under hair, as a shipped person's."""

from dataclasses import replace

import numpy as np

from render.avatars.maker import Maker
from render.avatars.photos.complete import NAPE_MM, ramp
from render.decoder import mesh_parts
from render.decoder.identity import Identity
from render.lighting import LUMINANCE
from render.types import Floats

ROOTS = (0.75, 0.45)  # brightness of a scalp, of its owner's face: from skin to roots
SCALP_MM, BACK_MM = (60.0, 78.0), (20.0, 5.0)  # above, or behind, are roots


def dressed(maker: Maker, who: Identity, lender: Identity) -> Identity:
    """With the lender's shirt, and the roots of the hair that is worn."""
    own = maker.gloss
    cloth = np.where(own > 0.02, 1 - lender.gloss / np.maximum(own, 0.02), 0).clip(0, 1)
    skin = maker.anchor_kinds == mesh_parts.SKIN
    cloth = np.where(skin & ~maker.face, cloth, 0).astype(np.float32)
    share = np.maximum(cloth, roots(maker, lender)) if len(lender.hair) else cloth
    albedo = who.albedo + share[:, None] * (lender.albedo - who.albedo)
    return replace(who, albedo=albedo.astype(np.float32), gloss=who.gloss * (1 - cloth))


def roots(maker: Maker, lender: Identity) -> Floats:  # [N] 0..1
    """Where the lender's scalp has the colour of hair."""
    head, light = maker.surface, lender.albedo @ LUMINANCE
    tone = float(np.median(light[maker.face]))
    dark = np.clip((ROOTS[0] - light / tone) / (ROOTS[0] - ROOTS[1]), 0, 1)
    _, up, ahead = (head.interpolate @ maker.template[head.used]).T
    behind = ramp(ahead, *BACK_MM) * ramp(up, *NAPE_MM)
    hairy = np.maximum(ramp(up, *SCALP_MM), behind)
    return (dark * hairy * (maker.anchor_kinds == mesh_parts.SKIN)).astype(np.float32)
