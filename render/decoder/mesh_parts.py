"""The head's surface as a renderer needs it: materials, texture coordinates, normals.

One row a distinct (vertex, texture coordinate, kind): the mesh has seams where one vertex has two
texture coordinates.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from render.types import Floats, Ints

SKIN, EYE, COLOURED, TEETH = range(4)


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


def vertex_normals(vertices: Floats, faces: Ints, gather: csr_array) -> Floats:  # [V, 3] unit
    a, b, c = (vertices.take(faces[:, k], 0) for k in range(3))
    normals = gather @ np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True) + np.float32(1e-9)
    return normals.astype(np.float32)
