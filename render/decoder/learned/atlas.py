"""Maps over the whole head: a small picture in texture space that vertices write and read.

Face left, back of the head beside it, mouth, teeth and eyes stacked at the right.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from render.types import Floats

HEIGHT, WIDTH = 64, 128


@dataclass(frozen=True)
class Atlas:
    """Linear maps between used vertices [U] and texels [HEIGHT * WIDTH]."""

    places: Floats  # [U, 2] texels, x and y
    to_vertices: csr_array  # [U, T] bilinear
    to_texels: csr_array  # [T, U] the nearest vertices, so that no texel is empty


def build(places: Floats) -> Atlas:
    """From each used vertex's place in texels."""
    from scipy.spatial import KDTree

    count = len(places)
    x = np.clip(places[:, 0] - 0.5, 0, WIDTH - 1.001)
    y = np.clip(places[:, 1] - 0.5, 0, HEIGHT - 1.001)
    i, j = x.astype(int), y.astype(int)
    fx, fy = x - i, y - j
    corners = ((0, 0, (1 - fx) * (1 - fy)), (1, 0, fx * (1 - fy)), (0, 1, (1 - fx) * fy))
    corners = (*corners, (1, 1, fx * fy))
    columns = np.stack([(j + dj) * WIDTH + i + di for di, dj, _ in corners], 1).astype(np.int32)
    weights = np.stack([w for *_, w in corners], 1).astype(np.float32)
    starts = np.arange(0, 4 * count + 1, 4, dtype=np.int32)
    to_vertices = csr_array((weights.ravel(), columns.ravel(), starts), (count, HEIGHT * WIDTH))
    texels = np.stack(np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT)), -1).reshape(-1, 2) + 0.5
    distance, near = KDTree(places).query(texels, k=4)
    closeness = 1 / (distance**2 + 0.05)
    closeness /= closeness.sum(1, keepdims=True)
    starts = np.arange(0, 4 * len(texels) + 1, 4)
    to_texels = csr_array(
        (closeness.ravel().astype(np.float32), near.ravel(), starts), (len(texels), count)
    )
    return Atlas(places, to_vertices, to_texels)


def picture(atlas: Atlas, values: Floats) -> Floats:  # [U, C] -> [C, HEIGHT, WIDTH]
    flat = atlas.to_texels @ values
    return np.ascontiguousarray(flat.T.reshape(-1, HEIGHT, WIDTH))
