"""A synthetic head made of blobs, how pictures are compared, and activations by name."""

import numpy as np
from numpy.typing import NDArray

from render.decoder.decoder import Decoder
from render.decoder.surface import BEHIND
from render.types import Gaussians

COLUMNS = 55  # 53 shapes of the rig and 2 of the tongue


def head_scene(num_gaussians: int = 6000, seed: int = 0) -> Gaussians:
    """Flat, randomly turned Gaussians on an ellipsoid the size of a head, eyes and mouth marked."""
    rng = np.random.default_rng(seed)
    radii = np.array([75.0, 125.0, 95.0])
    index = np.arange(num_gaussians) + 0.5
    y = 1.0 - 2.0 * index / num_gaussians
    turn, ring = index * np.pi * (3.0 - 5.0**0.5), np.sqrt(1.0 - y * y)
    unit = np.stack([ring * np.cos(turn), y, ring * np.sin(turn)], axis=1)
    means = unit * radii + (0.0, 15.0, 0.0)
    normals = unit / radii
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    # Shortest turn of +z onto the normal, after a random turn about z.
    tilt = np.stack(
        [1.0 + normals[:, 2] + 1e-9, -normals[:, 1], normals[:, 0], np.zeros(num_gaussians)], axis=1
    )
    spin = rng.uniform(0.0, np.pi, num_gaussians)
    cos, sin = np.cos(spin), np.sin(spin)
    w, a, b, _ = tilt.T
    quats = np.stack([w * cos, a * cos + b * sin, b * cos - a * sin, w * sin], axis=1)
    spacing = np.sqrt(4.0 * np.pi * 1e4 / num_gaussians)
    scales = spacing * np.stack(
        [rng.uniform(0.4, 0.8, num_gaussians), rng.uniform(0.3, 0.6, num_gaussians), 0 * y + 0.05],
        axis=1,
    )
    colors = (0.75, 0.55, 0.45) + 0.12 * np.sin(means / (13.0, 17.0, 11.0))
    colors += rng.normal(0.0, 0.03, colors.shape)
    for spot, radius, color in (
        ((32.0, 27.0, 85.0), 14.0, (0.1, 0.2, 0.5)),
        ((-32.0, 27.0, 85.0), 14.0, (0.1, 0.2, 0.5)),
        ((0.0, -45.0, 80.0), 22.0, (0.6, 0.1, 0.15)),
    ):
        colors[np.linalg.norm(means - spot, axis=1) < radius] = color
    arrays = (means, quats, scales, rng.uniform(0.3, 1.0, num_gaussians), colors.clip(0.0, 1.0))
    return Gaussians(*(np.ascontiguousarray(array, np.float32) for array in arrays))


def single(
    mean_mm: tuple[float, float, float], sigma_mm: float, opacity: float, color
) -> Gaussians:
    """One round Gaussian."""
    rows = ([mean_mm], [(1.0, 0.0, 0.0, 0.0)], [[sigma_mm] * 3], [opacity], [color])
    return Gaussians(*(np.asarray(row, np.float32) for row in rows))


def join(*clouds: Gaussians) -> Gaussians:
    """All Gaussians of several clouds."""
    names = ("means", "quats", "scales", "opacities", "colors")
    return Gaussians(*(np.concatenate([getattr(c, name) for c in clouds]) for name in names))


def take(cloud: Gaussians, index: NDArray) -> Gaussians:
    """Gaussians by index."""
    names = ("means", "quats", "scales", "opacities", "colors")
    return Gaussians(*(getattr(cloud, name)[index] for name in names))


def psnr_db(picture: NDArray, expected: NDArray) -> float:
    """Peak signal-to-noise ratio of 8-bit values, in dB; 99 if equal."""
    error = np.mean((picture.astype(np.float64) - expected.astype(np.float64)) ** 2)
    return 99.0 if error == 0.0 else float(10.0 * np.log10(255.0**2 / error))


def facing(normals: np.ndarray) -> np.ndarray:  # [n, 3] unit -> [n, 4] wxyz
    """The shortest turn from z to the normal, as the decoder gives it; see surface.normals_of."""
    x, y, z = normals.T
    return np.stack([z + BEHIND, -y, x, 0 * z], 1).astype(np.float32)


def rig_of(decoder: Decoder, **activations: float) -> np.ndarray:
    rig = np.zeros(COLUMNS, np.float32)
    for name, value in activations.items():
        rig[decoder.rig_names.index(name)] = value
    return rig
