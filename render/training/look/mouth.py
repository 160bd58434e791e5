"""Colours of what has no texture: teeth, gums, tongue and the inside of the cheeks."""

import numpy as np

from render.decoder.mesh_parts import SKIN_VERTICES
from render.training.data.crowns import ARCH_MM, single
from render.training.data.face_data import FaceData
from render.types import Floats, Ints

CROWN, NECK = (0.75, 0.69, 0.585), (0.62, 0.53, 0.40)  # linear: cool edge, warm at the gum
UPPER_MM, LOWER_MM = 9.0, 8.0  # height of a tooth
SIDE, SHARP = np.array([0.44, 0.52, 0.62]), 6  # how much darker a tooth is beside the next one
# How dark towards the throat, by z in mm: cheeks take light from side teeth, most from lower ones.
UPPER_SHADED = (70.0, 84.0, 93.0, 101.0, 106.0), (0.85, 0.6, 0.35, 0.12, 0.0)
LOWER_SHADED = (70.0, 84.0, 92.0, 99.0, 104.0), (0.88, 0.75, 0.5, 0.15, 0.0)
GUMS, TONGUE, CHEEKS = (0.60, 0.27, 0.25), (0.60, 0.28, 0.26), (0.34, 0.12, 0.11)


def colors(face: FaceData) -> Floats:  # [V, 3] stored
    out = np.ones((len(face.neutral), 3), np.float32)
    eyes = np.concatenate([face.regions["eyeball_l"], face.regions["eyeball_r"]])
    inside = np.ones(len(out), bool)
    inside[:SKIN_VERTICES] = False
    inside[eyes] = False
    points, r = face.neutral, face.regions
    out[inside] = CHEEKS
    out[r["gums_tongue"]] = np.array(GUMS) * (1 + 0.18 * waves(points[r["gums_tongue"]], 0.9))
    out[r["tongue"]] = np.array(TONGUE) * (1 + 0.20 * waves(points[r["tongue"]], 2.3))
    upper, lower = r["teeth_upper"], r["teeth_lower"]
    tip = np.percentile(points[upper, 1], 2), np.percentile(points[lower, 1], 98)
    for rows, height, shaded in (
        (upper, (points[upper, 1] - tip[0]) / UPPER_MM, UPPER_SHADED),
        (lower, (tip[1] - points[lower, 1]) / LOWER_MM, LOWER_SHADED),
    ):
        share = np.clip(height, 0, 1)[:, None]
        tooth = np.array(CROWN) * (1 - share) + np.array(NECK) * share
        tooth *= 1 - 0.16 * np.clip(1 - 5 * share, 0, 1) * np.array([1.2, 1.0, 0.7])
        back = np.interp(points[rows, 2], *shaded)[:, None]
        tooth *= 1 - SIDE * _beside(face, rows)[:, None] ** SHARP
        out[rows] = tooth * (1 - back * np.array([0.9, 1.0, 1.0]))
    out[inside] = np.sqrt(out[inside])
    return out


def _beside(face: FaceData, rows: Ints) -> Floats:  # [n] vertices of teeth -> [n] 0..1
    """How far they lie from the middle of their tooth, along the arch, towards the next one."""
    parts, points = single(face.faces, len(face.neutral))[rows], face.neutral[rows]
    out = np.zeros(len(rows), np.float32)
    for part in np.unique(parts):
        of_tooth = parts == part
        off = points[of_tooth] - points[of_tooth].mean(0)
        x, _, z = points[of_tooth].mean(0) - (0, 0, ARCH_MM)
        along = np.abs(off[:, [0, 2]] @ (max(z, 0), -x)) / np.hypot(max(z, 0), x)
        out[of_tooth] = along / along.max()
    return out


def waves(points: Floats, frequency: float) -> Floats:  # [n, 3] mm -> [n, 1] -1..1
    """Uneven brightness: a product of sines, which costs less than noise."""
    x, y, z = points.T * frequency
    a = np.sin(1.7 * x + 1.1 * np.sin(2.1 * y + 1.3))
    return (a * np.sin(1.9 * y + 2 + np.sin(1.6 * z)) * np.sin(2.3 * z + 0.7))[:, None]
