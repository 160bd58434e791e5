"""Rounded lips open as an ellipse: the face data's open as a diamond, its sides straight."""

import numpy as np
from scipy.spatial import KDTree

from render.types import Floats, Ints

INNER = [60, 61, 62, 63, 64]  # of the 68 landmarks: the line between the lips
# How far each lip goes from it, mm at full activation, where between the middle 0 and a corner 1,
# and how wide that is. Lips that purse keep their sides together: the opening is small.
BULGES = {
    "mouthFunnel": ((2.4, 0.72, 0.26), (1.1, 0.25, 0.2)),
    "mouthPucker": ((-1.4, 0.74, 0.24),),
}
FAR_MM = 13.0  # from the line, over which it fades


def rounded(
    rig: Floats,  # [R, V, 3] mm at full activation
    names: list[str],
    neutral: Floats,  # [V, 3] mm
    skin: int,  # the first vertices
    regions: dict[str, Ints],
    landmarks: Ints,  # [68]
) -> Floats:  # [R, V, 3] mm
    """The rig with other shapes of lips that funnel and purse."""
    points = neutral[:skin].astype(np.float64)
    line = neutral[landmarks[INNER]]
    up = points[:, 1] - np.interp(points[:, 0], line[:, 0], line[:, 1])
    side = np.sign(up)
    rows = np.concatenate([regions["lips_upper"], regions["lips_lower"]])
    above = np.where(np.isin(rows, regions["lips_upper"]), 1, -1)
    lips = np.concatenate([rows, regions["inner_mouth_lip_roll"]])
    side[lips] = above[np.asarray(KDTree(points[rows]).query(points[lips])[1])]
    share = np.abs(points[:, 0]) / np.abs(line[[0, -1], 0]).mean()
    near = np.clip((points[:, 2] - 88) / 8, 0, 1) * np.exp(-((up / FAR_MM) ** 2))
    near *= side * np.clip((1.06 - share) / 0.12, 0, 1)
    out = rig.copy()
    for name, bulges in BULGES.items():
        for most, at, half in bulges:
            out[names.index(name), :skin, 1] += most * near * np.exp(-(((share - at) / half) ** 2))
    return out
