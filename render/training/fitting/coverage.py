"""What follows for Gaussians from where they lie: how wide they must be, and how they mirror."""

import numpy as np

from render.avatars import textures
from render.decoder import mesh_parts
from render.decoder.cover import farthest
from render.training.fitting.wardrobe import Wardrobe
from render.training.geometry.anchors import Anchors, uv
from render.training.geometry.assembly import Assembly
from render.types import Floats

REACHED, GRID = 0.88, 4  # deviations to the furthest place; places along an edge of a triangle
WET_OIL, WET_ROUGH, TOOTH_OIL, TOOTH_ROUGH = 1.1, 0.28, 1.3, 0.20
PLAIN_OIL, PLAIN_ROUGH = 0.40, 0.50
# The one lobe of a Gaussian that is nearest to the two of the reference, and what the relief adds
# where it is finer than a Gaussian.
ONE_GLOSS, ONE_ROUGH, FINE_ROUGH = 0.87, 0.75, 0.03


def reach(assembly: Assembly, anchors: Anchors) -> Floats:  # [N] mm
    """Widths that leave no hole between neighbours: towards the place furthest from all of them."""
    face, kinds = assembly.face, assembly.kinds[anchors.triangles]
    points = (face.neutral[face.faces[anchors.triangles]] * anchors.barycentric[..., None]).sum(1)
    out = np.zeros(len(points), np.float32)
    grid = np.array([(i, j, GRID - i - j) for i in range(GRID + 1) for j in range(GRID + 1 - i)])
    for kind in (mesh_parts.SKIN, mesh_parts.EYE, mesh_parts.TEETH):
        rows, used = kinds == kind, np.unique(anchors.triangles[kinds == kind])
        places = ((grid / GRID) @ face.neutral[face.faces[used]]).reshape(-1, 3)
        out[rows] = farthest(points[rows].astype(np.float32), places.astype(np.float32))
    return np.minimum(out / np.float32(REACHED), 1.5 * anchors.scales).astype(np.float32)


def mirrors(
    assembly: Assembly, anchors: Anchors, wardrobe: Wardrobe
) -> tuple[Floats, Floats]:  # [N], [N]
    """How much Gaussians mirror, and how roughly."""
    kinds, at = assembly.kinds[anchors.triangles], uv(assembly, anchors)
    oil = np.full(len(kinds), PLAIN_OIL, np.float32)
    rough = np.full(len(kinds), PLAIN_ROUGH, np.float32)
    face = (kinds == mesh_parts.SKIN) & (at[:, 0] < 1)
    map_ = textures.soft(wardrobe.relief_map[..., 1:], 2.0)
    oil[face], rough[face] = textures.sample(map_, at[face]).T
    oil[kinds == mesh_parts.COLOURED], rough[kinds == mesh_parts.COLOURED] = WET_OIL, WET_ROUGH
    oil[kinds == mesh_parts.TEETH], rough[kinds == mesh_parts.TEETH] = TOOTH_OIL, TOOTH_ROUGH
    oil[kinds == mesh_parts.EYE] = 0
    return oil * np.float32(ONE_GLOSS), rough * np.float32(ONE_ROUGH) + np.float32(FINE_ROUGH)
