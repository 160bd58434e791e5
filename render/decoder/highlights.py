"""Highlights of the eyes: one round spot on each cornea, hidden where a lid covers it."""

import numpy as np

from render.decoder.posing import Posing, eye_rotation
from render.lighting import KEY
from render.types import Floats

OPACITY = 0.9
# From the centre of an eye that comes EYE_MM forward; on larger eyes both are larger.
CORNEA_MM, CORNEA_RADIUS_MM, EYE_MM = 6.2, 10.5, 15.95
# Where a highlight is, seen from the front: that of the lower half of the box, which lids leave.
HALF = KEY.towards * (1, 0.5, 1) + (0, 0, 1)
HALF /= np.linalg.norm(HALF)
ON_CORNEA = 0.42  # of that radius, how far off the middle of an iris it may be
LID_COVERS_MM, LID_CLEARS_MM = -0.3, 0.6  # the highlight's way out from behind the edge of a lid


def eye_sizes(posing: Posing, geometry: Floats, centers: Floats) -> Floats:  # -> [2]
    """How far forward both eyes of a face [V, 3] come, as shares of EYE_MM."""
    fronts = [geometry[eye, 2].max() for eye in posing.eyeballs]
    return (np.array(fronts) - centers[:, 2]) / EYE_MM


def place(
    posing: Posing,
    vertices: Floats,  # [V, 3] mm
    gaze: Floats,  # [2, 3] unit
    centers: Floats,  # [2, 3] mm
    sizes: Floats,  # [2]
    half: Floats,  # [3] unit: between lamp and viewer
    means: Floats,  # -> [2, 3] mm
    opacities: Floats,  # -> [2]
) -> None:
    pupils = np.stack([eye_rotation(gaze[eye], eye)[:, 2] for eye in range(2)])
    off = half - (pupils @ half)[:, None] * pupils
    off *= np.minimum(1, ON_CORNEA / np.maximum(np.linalg.norm(off, axis=1), 1e-6))[:, None]
    out = np.sqrt(1 - (off * off).sum(1))[:, None]
    cornea = (CORNEA_MM + CORNEA_RADIUS_MM * out) * pupils + CORNEA_RADIUS_MM * off
    means[:] = centers + sizes[:, None] * cornea
    for eye in range(2):
        clear = posing.lid_lines[eye].clearance(vertices, means[eye])
        share = (clear - LID_COVERS_MM) / (LID_CLEARS_MM - LID_COVERS_MM)
        opacities[eye] = OPACITY * min(max(share, 0.0), 1.0)
