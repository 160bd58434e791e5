"""How many Gaussians lie on the head: all that were fitted, or an even part of them.

A part needs no weights of its own: those that stay take over the area and the colours of their
neighbours that go, and are widened where holes would show (`cover.py`). Twice as many do:
put between the fitted ones they were .8 dB worse than these, since the fit is one of their places.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, vstack
from scipy.spatial import KDTree

from render.decoder import mesh_parts
from render.decoder.cover import nearest, spacing
from render.decoder.surface import Surface
from render.types import Density, Floats

Indices = NDArray[np.intp]
COUNTS: dict[Density, int | None] = {"16k": 16_000, "32k": 32_768, "65k": None}  # None: all
NEIGHBOURS, NEAREST = 12, 6  # that may crowd, that tell how dense the place is
NORMAL_MM = 6.0  # points and normals together: the two sides of a lip are neighbours in space only
KIND_MM = 1000.0  # apart are Gaussians of skin, eyes, mouth, teeth and lashes
EYES = 1.4  # times as near to each other are those of eyes, where people look first
FINE, LOOSE = 1.25, 0.75  # and those of lips, lids and nostrils; those of neck and ears
EARS_MM = (62, -40, -60), (200, 45, 40)  # box around them, |x| y z
SCALP_MM = 20.0  # above that, off the face and the ears: it has half as many as the neck
REACH = 1.5  # neighbours further than that do not crowd, in units of the spacing that is wanted
SHARE = 0.33  # smallest standard deviation, as a share of the distance to the neighbours
OPACITY = 0.85  # of skin, at least

# A layer below the skin of the face, see `layered`.
CELL_MM = 1.9  # one in each cell of a grid
NARROWER: dict[Density, float] = {"16k": 0.85, "32k": 0.8, "65k": 1.0}  # those above it
NEAR_MM, FLAT = 4.0, 0.75  # skin so near is flat if its normals agree: cosine
BELOW, DEPTH_MM, DEEP_OPACITY = 0.8, 1.0, 0.98  # width, as SHARE; under the skin
LONELY = 1.25  # of the usual distance to the others: wider ones inside a nostril show through it


class Layers(NamedTuple):
    """All Gaussians, those below among those above."""

    rows: NDArray[np.intp]  # [n] of those above
    shares: csr_array  # [n, M] see Decoder.shares
    widths: Floats  # [n] mm
    opacities: Floats  # [n]
    depths: Floats  # [n] mm under the skin


def choose(
    surface: Surface,
    mesh: Floats,  # [V, 3] mm, the mean face
    kinds: NDArray[np.integer],  # [N] see mesh_parts
    opacities: Floats,  # [N]
    fine: NDArray[np.bool_],  # [N] of which more stay, and ...
    loose: NDArray[np.bool_],  # [N] ... fewer, see groups
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
        stays, wider = np.zeros(len(points), bool), np.empty(len(points), np.float32)
        left, others = count, np.ones(len(points), bool)
        for group, nearer in (
            (kinds == mesh_parts.EYE, EYES),
            (fine, FINE),
            (loose, LOOSE),
            (others, 0),
        ):
            group = group & others
            size = int(group.sum())
            kept = min(round(nearer**2 * count / len(points) * size), size) if nearer else left
            stays[group], wider[group] = thinned(points[group], kept), np.sqrt(size / kept)
            left, others = left - kept, others & ~group
        rows = rows[stays[rows]]
        distance = nearest(points[rows], points[rows], 5)[0]
        widths = widths * wider
        widths[rows] = np.maximum(widths[rows], SHARE * distance[:, 1:].mean(1))
        owner = nearest(points[rows], points, 1)[1][:, 0]
    share = (1 / np.bincount(owner))[owner].astype(np.float32)
    shares = csr_array((share, (owner, np.arange(len(owner)))))
    opacities = shares @ opacities
    if count is not None:
        skin = kinds[rows] == mesh_parts.SKIN
        opacities[skin] = np.maximum(opacities[skin], OPACITY)
    return rows, shares, widths[rows].astype(np.float32), opacities


def thinned(points: NDArray[np.floating], count: int) -> NDArray[np.bool_]:  # [N, D] mm -> [N]
    """Take away the most crowded ones until so many are left, never two neighbours at once."""
    distance, near = nearest(points, points, NEIGHBOURS + 1)
    distance, near = distance[:, 1:], near[:, 1:]
    apart = distance[:, :NEAREST].mean(1)
    reach = REACH * 0.5 * (apart[:, None] + apart[near]) * np.sqrt(len(points) / count)
    crowding = np.clip(1 - distance / reach, 0, None) ** 4
    stays = np.ones(len(points), bool)
    jitter = 1e-6 * np.random.default_rng(0).random(len(points))  # breaks ties
    while (excess := int(stays.sum()) - count) > 0:
        weight = np.where(stays, (crowding * stays[near]).sum(1) + jitter, -1)
        worst = np.flatnonzero(stays & (weight > weight[near].max(1)))
        stays[worst[np.argsort(-weight[worst])][:excess]] = False
    return stays


def thick(
    head: Surface,
    mesh: Floats,  # [V, 3] mm, the mean face
    kinds: NDArray[np.integer],  # [N] see mesh_parts
    face: NDArray[np.int32],  # vertices
    edges: NDArray[np.int32],  # of lids and lips
) -> NDArray[np.bool_]:  # [N]
    """Where the skin has room below: on the face, where it is flat, off lids and lips."""
    points, normals = mesh[head.used], head.whole.normals(mesh)[0]
    on_face, on_edge = np.isin(head.used, face), np.isin(head.used, edges)
    a, b = KDTree(points).query_pairs(NEAR_MM, output_type="ndarray").T
    bent = np.einsum("nc,nc->n", normals[a], normals[b]) <= FLAT
    room = on_face & ~on_edge
    room[a[bent | on_edge[b]]] = False
    room[b[bent | on_edge[a]]] = False
    return (kinds == mesh_parts.SKIN) & (head.interpolate @ room.astype(np.float32) > 0.99)


def groups(
    head: Surface,
    mesh: Floats,  # [V, 3] mm, the mean face
    kinds: NDArray[np.integer],  # [N] see mesh_parts
    face: NDArray[np.int32],  # vertices
    deep: NDArray[np.bool_],  # [N] see thick
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:  # [N] each
    """Skin of the face where no layer lies below it: lips, lids, nostrils; and skin off the face
    and the scalp."""
    skin, points = kinds == mesh_parts.SKIN, head.interpolate @ mesh[head.used]
    low, high = np.array(EARS_MM)
    points[:, 0] = np.abs(points[:, 0])
    scalp = (points[:, 1] > SCALP_MM) & ~((points > low) & (points < high)).all(1)
    on_face = head.share_on(face) > 0
    return skin & on_face & ~deep, skin & ~on_face & ~scalp


def layered(
    head: Surface,  # those above, neighbours together
    mesh: Floats,  # [V, 3] mm, the mean face
    which: NDArray[np.bool_],  # [N] they get a layer below
    shares: csr_array,  # [N, M]
    opacities: Floats,  # [N]
) -> Layers:
    """An even choice of them once more, deeper and wide, in the mean colour of those above.

    Gaussians narrow enough to be sharp leave gaps, and in the gaps is the dark inside of a head:
    these close them.
    """
    above = np.flatnonzero(which)
    points = (head.interpolate @ mesh[head.used])[above]
    cells = np.floor(points / CELL_MM).astype(np.int64)
    middle = np.unique(cells, axis=0, return_index=True)[1]
    owner = nearest(points[middle], points, 1)[1][:, 0]
    weight = 1 / np.bincount(owner, minlength=len(middle))[owner]
    mean = csr_array((weight, (owner, above)), (len(middle), len(opacities)))
    count = len(opacities)
    rows = np.concatenate([np.arange(count), above[middle]])
    deep, wide = np.zeros(len(rows), np.float32), head.scales[rows].copy()
    apart = spacing(points[middle])
    deep[count:], wide[count:] = DEPTH_MM, BELOW * np.minimum(apart, LONELY * np.median(apart))
    shown = np.concatenate([opacities, np.full(len(middle), DEEP_OPACITY)]).astype(np.float32)
    both = csr_array(vstack([shares, mean @ shares]), dtype=np.float32)
    first = head.interpolate.indices.reshape(-1, 3).min(1)[rows]
    order = np.argsort(first, kind="stable")
    return Layers(rows[order], both[order], wide[order], shown[order], deep[order])
