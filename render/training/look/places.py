"""The face's half of the skin atlas, texel by texel: where on the mean face it lies.

Maps are [SIZE, SIZE], top row first, as pictures are.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import LinearNDInterpolator
from scipy.ndimage import gaussian_filter
from scipy.spatial import KDTree

from render.decoder.mesh_parts import SKIN_VERTICES
from render.training.data import contact_lines
from render.training.data.face_data import FaceData
from render.types import Floats

SIZE = 1024
REGIONS = {
    "lips": "lips",
    "lids": "eyelids",
    "brows": "brows",
    "face": "narrow_face",
    "roll": "inner_mouth_lip_roll",
}


@dataclass(frozen=True)
class Places:
    """Maps of the mean face."""

    points: Floats  # [SIZE, SIZE, 3] mm
    lips: Floats  # [SIZE, SIZE] 0..1, as the next ones
    lids: Floats
    brows: Floats
    face: Floats
    roll: Floats  # the inner side of the lips
    off_eyes: Floats  # [SIZE, SIZE] mm from the edges of the lids

    @property
    def across(self) -> Floats:
        """Distance from the middle, mm."""
        return np.abs(self.points[..., 0])

    @property
    def up(self) -> Floats:
        return self.points[..., 1]

    def spot(self, x: float, y: float, half_x: float, half_y: float) -> Floats:
        """A soft spot on both sides of the face; mm."""
        far = ((self.across - x) / half_x) ** 2 + ((self.up - y) / half_y) ** 2
        return np.exp(-far).astype(np.float32)

    @property
    def cheeks(self) -> Floats:
        return self.spot(38, 3, 20, 21)

    @property
    def nose(self) -> Floats:
        on = (self.across < 20) & (self.up > -16) & (self.up < 30) & (self.points[..., 2] > 98)
        return soft(on.astype(np.float32), 11)

    @property
    def chin(self) -> Floats:
        return self.spot(0, -66, 20, 14)

    @property
    def forehead(self) -> Floats:
        out = np.clip((self.up - 50) / 15, 0, 1) * np.clip(1.2 - self.across / 60, 0, 1)
        return out.astype(np.float32)


def build(face: FaceData) -> Places:
    """Interpolates what the vertices know; holes (mouth, eyes) are bridged."""
    rows = (face.faces.max(1) < SKIN_VERTICES) & (face.uv[face.uv_faces].max((1, 2)) < 1)
    vertices, first = np.unique(face.faces[rows], return_index=True)
    at = face.uv[face.uv_faces[rows].ravel()[first]]
    values = [face.neutral[vertices]]
    for name in REGIONS.values():
        values.append(np.isin(vertices, face.regions[name])[:, None].astype(np.float32))
    centres = (np.arange(SIZE) + 0.5) / SIZE
    u, v = np.meshgrid(centres, 1 - centres)
    maps = LinearNDInterpolator(at, np.concatenate(values, 1))(u, v)
    maps = np.nan_to_num(maps).astype(np.float32)
    masks = {name: maps[..., 3 + k] for k, name in enumerate(REGIONS)}
    points = maps[..., :3]
    edges = [contact_lines.lid(face, side) for side in "lr"]
    tree = KDTree(face.neutral[np.concatenate([v for e in edges for v in (e.upper, e.lower)])])
    off_eyes = np.asarray(tree.query(points)[0], np.float32)
    return Places(points=points, off_eyes=off_eyes, **masks)


def soft(values: NDArray[np.floating], sigma: float) -> Floats:  # [H, W] or [H, W, C], texels
    """Blurred in the picture's plane."""
    spread = (sigma, sigma, 0) if values.ndim == 3 else sigma
    return np.asarray(gaussian_filter(values, spread, truncate=3.0), np.float32)
