"""The fine relief of skin, and how it mirrors: procedural maps, the same for everyone."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.spatial import KDTree

from render.decoder.mesh_parts import SKIN_VERTICES
from render.training.data.face_data import FaceData
from render.training.look.places import Places, soft
from render.types import Floats

PORES_MM = {"fine": 0.75, "coarse": 1.5}  # distance of neighbours


@dataclass(frozen=True)
class Relief:
    """[SIZE, SIZE] each."""

    height: Floats  # mm
    oil: Floats  # weight of mirrored light, about 0.3..1.3
    rough: Floats  # of a bare micro facet, 0..1
    pores: Floats  # 0..1 deep
    patches: Floats  # noise of unit variance, 7 mm
    clouds: Floats  # 26 mm
    grain: Floats  # 0.9 mm


def build(face: FaceData, places: Places) -> Relief:
    """About 20 s."""
    points, nose, cheeks = places.points, places.nose, places.cheeks
    lips, lids = soft(places.lips, 2), soft(places.lids, 3)
    skin, forehead, chin = np.clip(1 - 1.2 * lips, 0, 1), places.forehead, places.chin
    fine, fine_cells = _pores(face, points, PORES_MM["fine"])
    coarse, coarse_cells = _pores(face, points, PORES_MM["coarse"])
    patches, clouds = noise(points, 7, 5, 4), noise(points, 26, 6, 3)
    grain = noise(points, 0.9, 7, 2)
    wide = np.clip(0.15 + nose + 0.9 * cheeks + 0.35 * forehead + 0.4 * chin, 0, 1.2) * (1 - lids)
    small = (0.55 + 0.45 * np.clip(forehead + chin + nose, 0, 1)) * (1 - 0.6 * lids)
    height = -0.030 * small * fine - 0.050 * wide * coarse
    height -= 0.010 * (1 - fine_cells) + 0.014 * (1 - coarse_cells)
    height = skin * (height + 0.010 * patches + 0.004 * grain)
    height += 0.045 * lips * noise(points * np.array([1, 0.12, 0.12], np.float32), 2.6, 11, 3)
    lines = np.sin((places.up + 2.2 * clouds) * 2 * np.pi / 9.5) ** 8
    height -= 0.010 * forehead * lines
    pores = np.clip(0.5 * fine + 0.8 * coarse * (0.35 + 0.65 * np.clip(nose + cheeks, 0, 1)), 0, 1)
    corner = places.spot(25, -35, 5, 5)
    oil = 0.50 + 0.38 * nose + 0.25 * forehead + 0.22 * cheeks + 0.15 * chin - 0.10 * lids
    oil = np.clip(oil + 0.06 * clouds + 0.03 * patches, 0.25, 1.1) * (1 - 0.35 * pores * skin)
    oil = (oil * (1 - lips) + 1.25 * lips * (1 - 0.8 * corner)) * (1 - 0.6 * corner)
    rough = np.clip(0.46 - 0.09 * nose - 0.05 * forehead + 0.012 * patches, 0.30, 0.60)
    rough = rough * (1 - lips) + 0.30 * lips
    maps = (height, oil, rough, pores * skin, patches, clouds, grain)
    return Relief(*(np.asarray(m, np.float32) for m in maps))


def noise(points: Floats, wavelength_mm: float, seed: int, octaves: int) -> Floats:
    """Value noise in space, of about unit variance: no seams."""
    lattice = np.random.default_rng(seed).standard_normal((64, 64, 64)).astype(np.float32)
    out = np.zeros(points.shape[:2], np.float32)
    amplitude, total, scale = 1.0, 0.0, wavelength_mm
    for octave in range(octaves):
        at = (points.reshape(-1, 3) / scale * 2 + octave * 17.3).T
        values = map_coordinates(lattice, at, order=1, mode="grid-wrap")
        out += np.float32(amplitude) * values.reshape(out.shape)
        total += amplitude**2
        amplitude, scale = 0.55 * amplitude, scale / 2.1
    return out / np.float32(np.sqrt(0.3 * total))


def _pores(face: FaceData, points: Floats, spacing: float) -> tuple[Floats, Floats]:
    """How deep a texel lies in a pore, and how far from the border of its cell; 0..1."""
    rng = np.random.default_rng(round(spacing * 100))
    centres = _scattered(face, spacing, rng)
    texels = points.reshape(-1, 3)
    near, cell = (np.asarray(x) for x in KDTree(centres).query(texels, k=2))
    size = np.clip(rng.lognormal(0, 0.35, len(centres)), 0.5, 2.2)[cell[:, 0]]
    radius = 0.22 * spacing * np.sqrt(size)
    pore = np.exp(-((near[:, 0] / radius) ** 2)) * np.clip(size - 0.35, 0, 1.4)
    border = np.clip((near[:, 1] - near[:, 0]) / (0.35 * spacing), 0, 1)
    shape = points.shape[:2]
    return pore.reshape(shape).astype(np.float32), border.reshape(shape).astype(np.float32)


def _scattered(face: FaceData, spacing: float, rng: np.random.Generator) -> Floats:  # [n, 3]
    """Points on the front of the skin that keep off each other."""
    rows = (face.faces.max(1) < SKIN_VERTICES) & (face.uv[face.uv_faces].max((1, 2)) < 1)
    a, b, c = (face.neutral[face.faces[rows, k]] for k in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    chosen = rng.choice(len(area), int(area.sum() / (0.75 * spacing**2)), p=area / area.sum())
    u, v = rng.random((2, len(chosen), 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    out = a[chosen] * (1 - u - v) + b[chosen] * u + c[chosen] * v
    for _ in range(2):
        distance, nearest = (np.asarray(x) for x in KDTree(out).query(out, k=2))
        away = (out - out[nearest[:, 1]]) / (distance[:, 1:] + 1e-6)
        out = out + 0.4 * away * np.clip(spacing - distance[:, 1:], 0, None)
    return out
