"""Metrics of the prior, from vertices and pictures; used by `livedrive eval prior`."""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, uniform_filter

from render.lighting import LUMINANCE
from render.types import Floats

Mask = NDArray[np.bool_]
SSIM_WINDOW_PX = 7
PAIR_MM, MOUTH_HALF_MM = 2.5, 20.0


def psnr_db(a: NDArray[np.uint8], b: NDArray[np.uint8], mask: Mask) -> float:
    """Peak signal-to-noise ratio inside the mask [H, W] of two pictures [H, W, 3]."""
    error = np.mean((a[mask].astype(np.float64) - b[mask]) ** 2)
    return 99.0 if error == 0 else float(10 * np.log10(255.0**2 / error))


def ssim(a: NDArray[np.uint8], b: NDArray[np.uint8], mask: Mask) -> float:
    """Structural similarity, mean of the windows centred inside the mask and of the channels."""
    x, y = a.astype(np.float64), b.astype(np.float64)
    size = (SSIM_WINDOW_PX, SSIM_WINDOW_PX, 1)

    def mean(v: NDArray[np.float64]) -> NDArray[np.float64]:
        return uniform_filter(v, size)  # pyright: ignore[reportArgumentType] (stub: one size only)

    mx, my = mean(x), mean(y)
    count = SSIM_WINDOW_PX**2
    unbiased = count / (count - 1)
    vx, vy = (mean(x * x) - mx * mx) * unbiased, (mean(y * y) - my * my) * unbiased
    vxy = (mean(x * y) - mx * my) * unbiased
    c1, c2 = (0.01 * 255) ** 2, (0.03 * 255) ** 2
    value = (2 * mx * my + c1) * (2 * vxy + c2) / ((mx * mx + my * my + c1) * (vx + vy + c2))
    return float(value[mask].mean())


def sharpness(a: NDArray[np.uint8], b: NDArray[np.uint8], mask: Mask) -> float:
    """Fine detail (what a blur of 1.2 pixels takes away) of `a` inside the mask, as a share of that
    of `b`."""
    inside = gaussian_filter(mask.astype(np.float32), 1.2) > 0.97
    detail = [
        light - gaussian_filter(light, 1.2)
        for light in (x.astype(np.float32) @ LUMINANCE for x in (a, b))
    ]
    return float(detail[0][inside].std() / max(detail[1][inside].std(), 1e-9))


def distances(a: Floats, b: Floats) -> Floats:  # [V, 3], [V, 3] -> [V] mm
    return np.linalg.norm(a - b, axis=-1)


class LipCrossing:
    """How deep the lips press into each other, from vertices that touch at rest."""

    def __init__(self, rest: Floats, upper: NDArray[np.int32], lower: NDArray[np.int32]) -> None:
        distance = np.linalg.norm(rest[upper][:, None] - rest[lower][None], axis=-1)
        near = (distance.min(1) < PAIR_MM) & (np.abs(rest[upper, 0]) < MOUTH_HALF_MM)
        self._upper, self._lower = upper[near], lower[distance[near].argmin(1)]
        self._rest = rest[self._upper, 1] - rest[self._lower, 1]

    def depth_mm(self, vertices: Floats) -> float:
        """0 when no vertex lies deeper in the other lip than it does at rest."""
        gap = vertices[self._upper, 1] - vertices[self._lower, 1]
        return float(np.maximum(np.minimum(self._rest, 0) - gap, 0).max())


def recovered_rig(
    moved: Floats,  # [T, V, 3] mm from rest
    basis: Floats,  # [V * 3, R]
) -> Floats:  # [T, R]
    """Activations that explain the motion best; a little ridge keeps twins apart."""
    gram = basis.T @ basis
    gram += np.eye(len(gram), dtype=np.float32) * gram.trace() / len(gram) * 1e-4
    return np.linalg.solve(gram, basis.T @ moved.reshape(len(moved), -1).T).T


def agreement(weights: Floats) -> float:  # [A, T, R] -> mean correlation of pairs of avatars
    """Pearson r over all frames and activations that move, mean over pairs."""
    flat = weights.reshape(len(weights), -1)
    r = np.atleast_2d(np.corrcoef(flat))
    return float(r[np.triu_indices(len(r), 1)].mean())


def iris_centre(picture: NDArray[np.uint8]) -> NDArray[np.float64]:  # [H, W, 3] -> [2] px
    """Centre of mass of a white iris on black."""
    weight = picture[..., 0].astype(np.float64) / 255
    rows, columns = np.mgrid[: weight.shape[0], : weight.shape[1]] + 0.5
    total = weight.sum()
    return np.array([(columns * weight).sum(), (rows * weight).sum()]) / max(total, 1e-9)
