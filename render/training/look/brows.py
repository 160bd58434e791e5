"""Brows: strands over the brow's landmarks, that lie along it and stand on the moving skin."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from render.decoder.beard import Beard, attached, frames, joined
from render.decoder.mesh_parts import SKIN_VERTICES
from render.training.data.face_data import FaceData
from render.types import Floats

LEFT, RIGHT = slice(22, 27), slice(17, 22)  # landmarks of both brows
PIECES, WIDTHS_MM = 2, (0.055, 0.030)
LOWER_MM = (-7.8, -7.0, -6.3, -6.4, -6.8)  # of the hair under the landmarks, inner to outer
HALF_MM, ANGLES_DEG = (2.8, 3.8, 3.4, 2.2, 1.0), (78, 66, 42, 22, 8)  # along the brow
AT, LENGTHS_MM = (0.0, 0.12, 0.5, 0.8, 1.0), (3.4, 5.4, 5.8, 4.8, 2.8)
# Both ends thin out: strands there are fewer, finer and lighter.
SHOWN, FINE = (0.45, 0.9, 1.0, 0.8, 0.35), (0.8, 1.0, 1.0, 0.9, 0.6)


@dataclass(frozen=True)
class Brows:
    """How they are worn."""

    count: int = 560  # of each
    thick: float = 1.0
    arch_mm: float = 0.0
    lift_mm: float = 0.0


def grow(
    face: FaceData,
    rest: Floats,  # [V, 3] mm
    normals: Floats,  # [V, 3]
    skin: NDArray[np.integer],  # [F, 3] triangles of the skin
    style: Brows,
    tint: tuple[float, float, float],  # stored
    seed: int,
) -> Beard:
    rng = np.random.default_rng((seed, 5))
    parts = []
    for side in (LEFT, RIGHT):
        points = rest[face.landmarks[side]].astype(np.float64)
        points = points[np.argsort(np.abs(points[:, 0]))]
        points[:, 1] += np.array(LOWER_MM) + style.lift_mm
        points[:, 1] += style.arch_mm * np.array([0, 0, 1, 0.6, 0])
        at, lines = _lines(points, rest, normals, style, rng)
        tree = KDTree(rest[skin].mean(1))
        corners = skin[tree.query(lines[:, 0])[1]]
        count = len(lines)
        color = np.array(tint) ** 2 * rng.lognormal(0, 0.25, (count, 1))
        light = np.full((count, 4), 0.85, np.float32)
        fine, shown = (np.interp(at, AT, share)[:, None] for share in (FINE, SHOWN))
        widths = (np.array(WIDTHS_MM) * style.thick * fine).astype(np.float32)
        opacities = np.repeat(0.85 * shown, PIECES, 1).astype(np.float32)
        lines = (lines + 0.15 * frames(rest, corners)[:, None, :, 2]).astype(np.float32)
        parts.append(attached(lines, widths, corners, rest, opacities, color.clip(0, 1), light))
    return joined(parts)


def _lines(
    points: NDArray[np.floating],
    rest: Floats,
    normals: Floats,
    style: Brows,
    rng: np.random.Generator,
) -> tuple[NDArray[np.floating], Floats]:  # [n] 0..1 along the brow, [n, PIECES + 1, 3] mm
    count, up = style.count, np.array([0, 1.0, 0])
    at = rng.beta(1.15, 1.35, count)
    spots, fine = np.linspace(0, 1, 5), np.linspace(0, 1, 60)
    centre = np.stack([np.interp(at, spots, c) for c in points.T], 1)
    along = np.stack([np.gradient(np.interp(fine, spots, c)) for c in points.T], 1)
    along = np.stack([np.interp(at, fine, c) for c in along.T], 1)
    off = 2 * rng.beta(1.5, 1.5, count) - 1
    root = centre + up * (off * style.thick * np.interp(at, AT, HALF_MM))[:, None]
    tree = KDTree(rest[:SKIN_VERTICES])
    for _ in range(2):
        distance, near = (np.asarray(x) for x in tree.query(root, k=6))
        weight = 1 / (distance + 0.3)
        weight = (weight / weight.sum(1, keepdims=True))[..., None]
        place, normal = (rest[near] * weight).sum(1), (normals[near] * weight).sum(1)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        root = root - ((root - place) * normal).sum(1, keepdims=True) * normal
    flat = [_unit(v - (v * normal).sum(1, keepdims=True) * normal) for v in (up[None], along)]
    angle = np.interp(at, (0, 0.08, 0.25, 0.6, 1), ANGLES_DEG) + rng.normal(0, 12, count)
    angle = np.radians(angle - off * np.interp(at, (0, 0.3, 1), (4, 22, 16)))[:, None]
    way = np.cos(angle) * flat[1] + np.sin(angle) * flat[0]
    mm = np.interp(at, AT, LENGTHS_MM) * rng.lognormal(0, 0.24, count) * (0.8 + 0.2 * style.thick)
    t = np.linspace(0, 1, PIECES + 1)[None, :, None]
    bend = 0.16 * rng.normal(1, 0.3, (count, 1)) * (flat[1] - way)
    lines = root[:, None] + mm[:, None, None] * (t * way[:, None] + t**2 * bend[:, None])
    return at, (lines + normal[:, None] * 0.25 * np.sin(np.pi * t)).astype(np.float32)


def _unit(v: Floats) -> Floats:
    return v / (np.linalg.norm(v, axis=1, keepdims=True) + 1e-9)
