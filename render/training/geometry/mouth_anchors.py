"""Where the Gaussians of teeth, gums and tongue go: on what an open mouth shows, dense and narrow.

Teeth are single, with dark between them: a Gaussian of millimetres on the side of a tooth would
fill the gap and hang below its edge. So only crowns have Gaussians, on their fronts and along the
edges that bite; roots lie in the gums, backs are closed by the fronts. Gums are dense where they
end at the crowns, the tongue is at its tip, which comes to the teeth.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from render.decoder import mesh_parts
from render.training.data.crowns import ARCH_MM, single
from render.training.geometry.assembly import Assembly
from render.training.geometry.scatter import scatter
from render.types import Floats, Ints

CROWNS_MM = {"teeth_upper": 11.0, "teeth_lower": 9.5}  # height of a crown, and a bit of its neck
EDGE_MM = 0.9  # along the edge that bites
FACING = 0.2  # cosine to the way out of the arch
FRONT_MM, BACK_MM, BACK_SHARE = 92.0, 72.0, 0.25  # incisors, molars: their share of the density
GUM_REACH_MM, GUM_FRONT = 5.0, 14.0  # from the crowns; how much denser
ROOT_MM, TIP_MM, TIP_DENSER = 55.0, 92.0, 6.0  # of the tongue: not seen, most seen
WIDTH = 0.76  # standard deviation, in units of the distance to the neighbours
SPARE = 1.04  # thrown, of those that are kept


def place(
    assembly: Assembly,
    density: Callable[[Assembly], Floats],  # [F]: crowns, gums
    count: int,
    seed: int,
    allowed: NDArray[np.bool_] | None = None,  # [F] default: every triangle
) -> tuple[Ints, Floats, Floats]:
    """Triangles [count], barycentric coordinates [count, 3] and widths [count], mm."""
    face, rng = assembly.face, np.random.default_rng((seed, 3))
    corners = face.neutral[face.faces].astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area, wanted = 0.5 * np.linalg.norm(normals, axis=1), density(assembly).astype(np.float64)
    if allowed is not None:
        wanted[~allowed] = 0
    size, triangles, barycentric = SPARE, np.zeros(0, np.int32), np.zeros((0, 3), np.float32)
    while len(triangles) < count:
        scale = size * count / (area * wanted).sum()
        triangles, barycentric = scatter(corners, normals, area, scale * wanted, rng)
        size *= SPARE
    points = (corners[triangles] * barycentric[..., None]).sum(1)
    apart = np.asarray(KDTree(points).query(points, k=5)[0])[:, 1:]
    crowded = apart[:, 0] * np.sqrt(wanted[triangles])
    keep = np.sort(np.argsort(-crowded, kind="stable")[:count])
    widths = WIDTH * apart.mean(1)[keep]
    return triangles[keep], barycentric[keep], widths.astype(np.float32)


def crowns(assembly: Assembly) -> Floats:  # [F]
    """Density on the teeth."""
    face = assembly.face
    teeth = assembly.kinds == mesh_parts.TEETH
    tooth = single(face.faces, len(face.neutral))[face.faces[:, 0]]
    middles = face.neutral[face.faces].mean(1)
    out = np.zeros(len(face.faces), np.float32)
    for region, height in CROWNS_MM.items():
        members = np.isin(face.faces, face.regions[region]).all(1) & teeth
        way = 1 if region == "teeth_upper" else -1
        for one in np.unique(tooth[members]):
            rows = np.flatnonzero(members & (tooth == one))
            up = way * face.neutral[face.faces[rows], 1].reshape(len(rows), -1)
            above = way * middles[rows, 1] - up.min()
            shown = (_facing(assembly, rows) > FACING) | (above < EDGE_MM)
            out[rows[shown & (above < height)]] = 1
    return out * _towards_front(middles)


def gums(assembly: Assembly) -> Floats:  # [F]
    """Density on the gums."""
    face = assembly.face
    rows = np.flatnonzero(np.isin(face.faces, face.regions["gums"]).all(1) & (assembly.kinds >= 0))
    middles, out = face.neutral[face.faces].mean(1), np.zeros(len(face.faces), np.float32)
    tree = KDTree(middles[crowns(assembly) > 0])
    near = np.asarray(tree.query(middles[rows])[0]) < GUM_REACH_MM
    shown = near & (_facing(assembly, rows) > 0)
    out[rows] = np.where(shown, GUM_FRONT, 1) * _towards_front(middles[rows])
    return out


def tongue(assembly: Assembly) -> Floats:  # [F]
    """Density on the tongue."""
    face = assembly.face
    rows = np.isin(face.faces, face.regions["tongue"]).all(1)
    share = np.clip((face.neutral[face.faces].mean(1)[:, 2] - ROOT_MM) / (TIP_MM - ROOT_MM), 0, 1)
    return np.where(rows & (share > 0), 1 + TIP_DENSER * share**3, 0).astype(np.float32)


def _facing(assembly: Assembly, rows: NDArray[np.integer]) -> Floats:  # [n] -> [n]
    """Cosine between a triangle's normal and the way out of the arch."""
    corners = assembly.face.neutral[assembly.face.faces[rows]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    out = corners.mean(1) - (0.0, 0.0, ARCH_MM)
    out[:, 1], out[:, 2] = 0, np.maximum(out[:, 2], 0)
    length = np.linalg.norm(normals, axis=1) * np.linalg.norm(out, axis=1) + 1e-9
    return (normals * out).sum(1) / length


def _towards_front(points: Floats) -> Floats:  # [n, 3] mm -> [n]
    share = np.clip((points[:, 2] - BACK_MM) / (FRONT_MM - BACK_MM), 0, 1)
    return (BACK_SHARE + (1 - BACK_SHARE) * share).astype(np.float32)
