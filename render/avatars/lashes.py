"""Lashes for anyone: strands that stand on the edges of the lids and turn with them."""

import numpy as np
from numpy.typing import NDArray

from render.decoder.beard import Beard, attached, joined
from render.decoder.posing import Posing, Rest
from render.types import Floats

UPPER, LOWER = (130, 6.0, 0.10, 0.72), (70, 2.8, -0.45, -0.35)  # count, mm, rise, curl
BINS, PIECES = 24, 3
WIDTHS_MM = (0.050, 0.037, 0.019)  # standard deviations along a lash
COLOR = (0.010, 0.0075, 0.006)
EDGE = 4  # vertices of the skin around a place on the edge
SPAN_MM = 3.5  # along the edge, from a root to the places that it stands between


def grow(
    posing: Posing,
    rest: Rest,
    length: float = 1.0,
    color: tuple[float, float, float] = COLOR,  # linear
) -> Beard:
    """Both lids of both eyes, always the same ones."""
    rng = np.random.default_rng(17)
    parts = []
    for eye, line in enumerate(posing.lid_lines):
        centre = rest.eye_centers[eye]
        for vertices, kind in ((line.upper, UPPER), (line.lower, LOWER)):
            lines = _lines(rest.geometry, np.unique(vertices), kind, centre, length, rng)
            ball = posing.eyeballs[eye]
            parts.append(_standing(lines, rest.geometry, np.unique(vertices), ball, centre, color))
    return joined(parts)


def _lines(
    face: Floats,
    edge: NDArray[np.integer],
    kind: tuple[int, float, float, float],
    centre: Floats,
    length: float,
    rng: np.random.Generator,
) -> Floats:  # [n, PIECES + 1, 3] mm
    count, long, rise, curl = kind
    points = face[edge].astype(np.float64)
    xs = np.linspace(points[:, 0].min() + 0.6, points[:, 0].max() - 0.6, BINS)
    near = np.abs(points[:, 0][None] - xs[:, None]).argsort(1)[:, :EDGE]
    smooth = points[near].mean(1)
    padded = np.pad(smooth, ((3, 3), (0, 0)), "reflect", reflect_type="odd")
    smooth = np.stack([np.convolve(c, np.ones(7) / 7, "valid") for c in padded.T], 1)
    at = np.sort(rng.uniform(0.04, 0.97, count))
    root = np.stack([np.interp(at, np.linspace(0, 1, BINS), c) for c in smooth.T], 1)
    root += (0, 0.15, 0.35) if rise > 0 else (0, -0.3, 0.55)
    side, outer = 2 * (at - 0.5), np.sign(centre[0])
    way = np.stack([0.55 * side + 0.12 * outer, rise - 0.15 * np.abs(side), np.full(count, 0.9)], 1)
    way += rng.normal(0, 0.07, way.shape)
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    mm = length * long * (0.55 + 0.55 * np.clip((side * outer + 1) / 2, 0, 1))
    mm = mm * (1 - 0.45 * np.abs(side) ** 3) * rng.lognormal(0, 0.13, count)
    t = np.linspace(0, 1, PIECES + 1)[None, :, None]
    bend = 0.55 * curl * (np.array([0, 1.0, 0]) - 0.25 * way)
    return (root[:, None] + mm[:, None, None] * (t * way[:, None] + t**2 * bend[:, None])).astype(
        np.float32
    )


def _standing(
    lines: Floats,
    face: Floats,
    edge: NDArray[np.integer],  # [k] vertices along the edge of a lid
    eyeball: NDArray[np.integer],
    centre: Floats,
    color: tuple[float, float, float],
) -> Beard:
    """On triangles of two places on the edge and one pole of the eyeball, the farther of those that
    lie beside its centre: these turn about the eye as the lid does, however its skin folds."""
    edge = edge[np.argsort(face[edge, 0])]
    xs, root = face[edge, 0], lines[:, 0, 0]
    apart = np.abs(xs - (root[:, None, None] + np.array([[-SPAN_MM], [SPAN_MM]])))
    ends = edge[apart.argmin(2)]
    arm = face[eyeball] - centre
    poles = eyeball[[(side * arm[:, 0] - np.hypot(*arm[:, 1:].T)).argmax() for side in (1, -1)]]
    corners = np.column_stack([ends, poles[(root > centre[0]).astype(int)]])
    count = len(lines)
    widths = np.tile(np.array(WIDTHS_MM, np.float32), (count, 1))
    return attached(
        lines, widths, corners, face, np.full(widths.shape, 0.8, np.float32),
        np.tile(np.array(color, np.float32), (count, 1)), np.full((count, 4), 0.6, np.float32),
    )  # fmt: skip
