"""Teeth: how their light is read from the map of the light decoder.

In the map many teeth lie on the same texels, so the network can only learn their mean: a smile
would show grey teeth, one brighter than the next. The light on a tooth follows from that around it
(lips, jaw, tongue): a linear regression on a few texels of the map says it, for every vertex.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.types import Floats

TEXELS = 12
RIDGE = 1e-3  # share of the mean variance of a texel
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
