"""How many Gaussians lie on the head: all that were fitted, or an even half of them.

Half needs no weights of its own: those that stay take over the area and the colours of their
neighbours that go, and are widened where holes would show (`render/cover.py`). Twice as many do:
put between the fitted ones they were .8 dB worse than these, since the fit is one of their places.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.spatial import KDTree

from render import mesh_parts
from render.surface import Surface
from render.types import Density

Floats = NDArray[np.float32]
Indices = NDArray[np.intp]
COUNTS: dict[Density, int | None] = {"16k": 16_000, "32k": None}  # None: all
NEIGHBOURS, NEAREST = 12, 6  # that may crowd, that tell how dense the place is
NORMAL_MM = 6.0  # points and normals together: the two sides of a lip are neighbours in space only
KIND_MM = 1000.0  # apart are Gaussians of skin, eyes, mouth, teeth and lashes
REACH = 1.5  # neighbours further than that do not crowd, in units of the spacing that is wanted
SHARE = 0.4  # smallest standard deviation, as a share of the distance to the neighbours
OPACITY = 0.85  # of skin, at least


def choose(
    surface: Surface,
    mesh: Floats,  # [V, 3] mm, the mean face
    kinds: NDArray[np.integer],  # [N] see mesh_parts
    opacities: Floats,  # [N]
    preset: Density,
) -> tuple[Indices, csr_array, Floats, Floats]:
    """The anchors that stay [n], neighbours together: what the loops of the decoder read is at
    hand; a map [n, N] from values of all to theirs; their widths [n], mm, and opacities [n]."""
    count = COUNTS[preset]
    rows = np.argsort(surface.interpolate.indices.reshape(-1, 3).min(1), kind="stable")
    widths, owner = surface.scales, np.argsort(rows)
    if count is not None:
        normals = surface.interpolate @ surface.whole.normals(mesh)[0]
        places = surface.interpolate @ mesh[surface.used]
        points = np.c_[places, NORMAL_MM * normals, KIND_MM * kinds]
        # a KDTree that splits at 0 goes on from the next number, which counts as 0 (and the tree
        # never ends) where ONNX Runtime has this thread take denormals for zero
        points += 1 - points.min(0)
        rows = rows[thinned(points, count)[rows]]
        distance = np.asarray(KDTree(points[rows]).query(points[rows], k=5)[0])
        widths = widths * np.sqrt(len(points) / count)
        widths[rows] = np.maximum(widths[rows], SHARE * distance[:, 1:].mean(1))
        owner = np.asarray(KDTree(points[rows]).query(points)[1])
    share = (1 / np.bincount(owner))[owner].astype(np.float32)
    reads = csr_array((share, (owner, np.arange(len(owner)))))
    opacities = reads @ opacities
    if count is not None:
        skin = kinds[rows] == mesh_parts.SKIN
        opacities[skin] = np.maximum(opacities[skin], OPACITY)
    return rows, reads, widths[rows].astype(np.float32), opacities


def thinned(points: NDArray[np.floating], count: int) -> NDArray[np.bool_]:  # [N, D] mm -> [N]
    """Take away the most crowded ones until so many are left, never two neighbours at once."""
    found = KDTree(points).query(points, k=NEIGHBOURS + 1)
    distance, near = (np.asarray(x)[:, 1:] for x in found)
    apart = distance[:, :NEAREST].mean(1)
    reach = REACH * 0.5 * (apart[:, None] + apart[near]) * np.sqrt(len(points) / count)
    crowding = np.clip(1 - distance / reach, 0, None) ** 4
    stays = np.ones(len(points), bool)
    jitter = 1e-6 * np.random.default_rng(0).random(len(points))  # no two alike
    while (excess := int(stays.sum()) - count) > 0:
        weight = np.where(stays, (crowding * stays[near]).sum(1) + jitter, -1)
        worst = np.flatnonzero(stays & (weight > weight[near].max(1)))
        stays[worst[np.argsort(-weight[worst])][:excess]] = False
    return stays
