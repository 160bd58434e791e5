"""The head's surface as a renderer needs it: materials, texture coordinates, normals.

One row a distinct (vertex, texture coordinate, kind): the mesh has seams where one vertex has two
texture coordinates.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from render.decoder.kernels import surface as kernels
from render.types import Floats, Ints, Shorts

SKIN, EYE, COLOURED, TEETH = range(4)
SKIN_VERTICES = 11_248  # face and back of the head; they come first in the mesh


@dataclass(frozen=True)
class Parts:
    """Attributes of each corner of the mesh."""

    vertex: Ints  # [C] row of the mesh's vertices
    uv: Floats  # [C, 2], v up; of the material's own picture
    kind: Ints  # [C] SKIN .. TEETH
    opaque: Ints  # [F, 3] triangles, rows of the above


def build(
    faces: Ints,  # [F, 3]
    uv_faces: Ints,  # [F, 3]
    uv: Floats,  # [U, 2]
    kinds: Ints,  # [F] kind of each triangle, -1: not drawn
) -> Parts:
    """Merge equal corners."""
    drawn = kinds >= 0
    rows = np.stack([faces[drawn].ravel(), uv_faces[drawn].ravel(), np.repeat(kinds[drawn], 3)], 1)
    unique, index = np.unique(rows, axis=0, return_inverse=True)
    triangles = index.reshape(-1, 3).astype(np.int32)
    return Parts(
        unique[:, 0].astype(np.int32),
        uv[unique[:, 1]].astype(np.float32),
        unique[:, 2].astype(np.int32),
        triangles,
    )


def normal_sum(faces: Ints, num_vertices: int) -> csr_array:  # [V, F]
    """Adds the normals of the triangles around each vertex."""
    rows = faces.ravel()
    columns = np.repeat(np.arange(len(faces)), 3)
    ones = np.ones(len(rows), np.float32)
    return csr_array((ones, (rows, columns)), shape=(num_vertices, len(faces)))


def scattered(
    weights: NDArray[np.floating],  # [F] of triangles: their areas, say
    count: int,
    rng: np.random.Generator,
) -> tuple[NDArray[np.int64], Floats]:  # [n], [n, 3]
    """Random places: rows of triangles, and barycentric coordinates there."""
    rows = rng.choice(len(weights), size=count, p=weights / weights.sum())
    return rows, rng.dirichlet((1, 1, 1), count).astype(np.float32)


def vertex_normals(vertices: Floats, faces: Ints, gather: csr_array) -> Floats:  # [V, 3] unit
    a, b, c = (vertices.take(faces[:, k], 0) for k in range(3))
    normals = gather @ np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True) + np.float32(1e-9)
    return normals.astype(np.float32)


@dataclass(frozen=True)
class Triangles:
    """Triangles around some vertices."""

    corners: Shorts  # [F, 3] rows of the mesh's vertices
    rows: Shorts  # [F, 3] which of the n vertices each corner is, or n: none
    count: int  # n

    def normals(self, vertices: Floats) -> tuple[Floats, Floats, Floats]:
        """[V, 3] mm -> unit normals [n, 3], twice the areas around each vertex [n] and of each
        triangle [F + 1], mm^2; the last is 1, for what never stretches."""
        normals, totals, areas = np.empty((self.count, 3), np.float32), *self.around(vertices)
        kernels.normalise(totals, np.arange(self.count, dtype=np.int32), normals)
        return normals, totals[:-1, 3], areas

    def around(self, vertices: Floats) -> tuple[Floats, Floats]:
        """[V, 3] mm -> [n + 1, 4], [F + 1]: see kernels.around_vertices."""
        totals = np.empty((self.count + 1, 4), np.float32)
        areas = np.empty(len(self.corners) + 1, np.float32)
        kernels.around_vertices(vertices, self.corners, self.rows, totals, areas)
        return totals, areas
