"""Even points on a mesh, as dense as told."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from render.types import Floats, Ints

CANDIDATES = 8  # darts thrown a Gaussian kept
SPACING = 0.82  # smallest distance of two neighbours, in units of 1 / sqrt(density)
RELAXATIONS = 4


def scatter(
    corners: NDArray[np.floating],  # [F, 3, 3] mm
    normals: NDArray[np.floating],  # [F, 3]
    area: NDArray[np.floating],  # [F] mm^2
    density: NDArray[np.float64],  # [F] Gaussians a mm^2
    rng: np.random.Generator,
) -> tuple[Ints, Floats]:  # triangles [N], barycentric [N, 3]
    """Poisson-disk points, then Lloyd's relaxation over the darts: even cover without holes."""
    expected = np.cumsum(area * density) * CANDIDATES
    darts = np.searchsorted(expected, rng.uniform(0, expected[-1], int(expected[-1])))
    u, v = rng.uniform(0, 1, (2, len(darts)))
    fold = u + v > 1
    u[fold], v[fold] = 1 - u[fold], 1 - v[fold]
    barycentric = np.stack([1 - u - v, u, v], 1)
    points = (corners[darts] * barycentric[..., None]).sum(1)
    normal = (normals / (np.linalg.norm(normals, axis=1, keepdims=True) + 1e-9))[darts]
    radius = SPACING / np.sqrt(density[darts])
    tree = KDTree(points)
    free, kept = np.ones(len(darts), bool), []
    for dart in range(len(darts)):
        if free[dart]:
            kept.append(dart)
            near = np.array(tree.query_ball_point(points[dart], radius[dart]))
            free[near[normal[near] @ normal[dart] > 0.3]] = False
    # Points and normals together: the two sides of a lip are neighbours in space only.
    both = np.concatenate([points, 6.0 * normal], 1)
    chosen = np.array(kept)
    for _ in range(RELAXATIONS):
        _, owner = KDTree(both[chosen]).query(both)
        size = np.bincount(owner, minlength=len(chosen))[:, None] + 1e-9
        centre = np.stack([np.bincount(owner, both[:, k], len(chosen)) for k in range(6)], 1) / size
        _, chosen = KDTree(both).query(centre)
        chosen = np.unique(chosen)
    return darts[chosen].astype(np.int32), barycentric[chosen].astype(np.float32)
