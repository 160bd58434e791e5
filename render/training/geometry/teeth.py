"""Teeth: how their light is read from the map of the light decoder; how far they are behind lips.

In the map many teeth lie on the same texels, so the network can only learn their mean: a smile
would show grey teeth, one brighter than the next. The light on a tooth follows from that around it
(lips, jaw, tongue): a linear regression on a few texels of the map says it, for every vertex.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from render.decoder.mesh_parts import SKIN_VERTICES
from render.training.data.face_data import FaceData
from render.types import Floats

TEXELS = 12
RIDGE = 1e-3  # share of the mean variance of a texel
BEHIND_MM, MOST_MM, NEAR, FRONT_MM = 4.0, 4.0, 3, 60.0
TARGETS = 12  # principal components of the teeth's light that choose the texels


def light(
    maps: Floats,  # [N, T, 2] change of light that the decoder draws, by expression
    truth: Floats,  # [N, M, 2] change of light on the teeth's vertices
    rows: NDArray[np.integer],  # [M] of the used vertices
) -> dict[str, NDArray[Any]]:
    """For the prior's file: texels [TEXELS], and weights [M, TEXELS] that predict every vertex.

    Greedy (orthogonal matching pursuit): each texel is the one that explains most of what is left.
    """
    moves = maps.std(0).sum(1)
    candidates = np.flatnonzero(moves > np.median(moves))
    x = np.concatenate([maps[:, candidates, k] for k in range(2)])  # both kinds of light: rows
    y = np.concatenate([truth[..., k] for k in range(2)])
    left, scale, _ = np.linalg.svd(y, full_matrices=False)
    aim, rest = left[:, :TARGETS] * scale[:TARGETS], x.copy()
    smallest = RIDGE * (x * x).sum(0).max()
    chosen: list[int] = []
    for _ in range(TEXELS):
        explained = ((rest.T @ aim) ** 2).sum(1) / ((rest * rest).sum(0) + smallest)
        chosen.append(int(explained.argmax()))
        basis, _ = np.linalg.qr(x[:, chosen])
        rest -= basis @ (basis.T @ rest)
        aim -= basis @ (basis.T @ aim)
    picked = x[:, chosen]
    gram = picked.T @ picked
    gram += np.eye(TEXELS, dtype=np.float32) * RIDGE * gram.trace() / TEXELS
    weights = np.linalg.solve(gram, picked.T @ y).T
    return {
        "teeth_rows": rows.astype(np.int32),
        "teeth_texels": candidates[chosen].astype(np.int32),
        "teeth_light": weights.astype(np.float16),
    }


def set_back(face: FaceData, vertices: Floats) -> Floats:  # [V, 3] mm, [V, 3] mm
    """A head whose teeth and gums lie BEHIND_MM behind the skin around its mouth, at rest: a thin
    lip that a smile draws over nearer ones lets them through."""
    regions, skin = face.regions, np.arange(SKIN_VERTICES)
    inner = np.concatenate([regions["mouth_socket"], regions["inner_mouth_lip_roll"]])
    skin = skin[~np.isin(skin, inner) & (vertices[skin, 2] > FRONT_MM)]
    upper = np.concatenate([regions["teeth_upper"], regions["gums"]])
    upper = upper[vertices[upper, 1] > vertices[regions["lips_upper"], 1].mean()]
    near = np.asarray(KDTree(vertices[skin, :2]).query(vertices[upper, :2], k=NEAR)[1])
    clear = float((vertices[skin[near], 2].mean(1) - vertices[upper, 2]).min())
    out = vertices.copy()
    inside = np.union1d(regions["teeth"], regions["gums_tongue"])
    out[inside, 2] -= np.clip(BEHIND_MM - clear, 0, MOST_MM)
    return out
