"""Lashes for anyone: strands that stand on the edges of the lids."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from render.decoder.beard import Beard, attached, frames, joined
from render.decoder.lines import Line
from render.decoder.posing import Posing, Rest
from render.types import Floats

UPPER, LOWER = (130, 6.0, 0.10, 0.85), (70, 2.8, -0.45, -0.35)  # count, mm, rise, curl
BINS, PIECES = 24, 3
WIDTHS_MM = (0.045, 0.034, 0.018)  # standard deviations along a lash
COLOR = (0.020, 0.015, 0.012)
EDGE = 4  # vertices of the skin around a place on the edge
RISE_MM = 2.0  # from the edge to the skin that they stand on: at the edge it folds


def grow(
    posing: Posing,
    rest: Rest,
    skin: NDArray[np.integer],  # [F, 3] triangles of the skin
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
            parts.append(_standing(lines, rest.geometry, skin, line, color, kind is UPPER))
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
    skin: NDArray[np.integer],
    line: Line,
    color: tuple[float, float, float],
    upper: bool,
) -> Beard:
    """On the triangles of the lid that face forward there."""
    edge = np.concatenate([line.upper, line.lower])
    around = skin[np.linalg.norm(face[skin].mean(1) - face[edge].mean(0), axis=1) < 25]
    forward = frames(face, around)[:, 2, 2] > 0.25
    around = around[forward]
    lid = lines[:, 0] + np.array([0, RISE_MM if upper else -RISE_MM, 0], np.float32)
    _, nearest = KDTree(face[around].mean(1)).query(lid)
    count = len(lines)
    widths = np.tile(np.array(WIDTHS_MM, np.float32), (count, 1))
    return attached(
        lines, widths, around[nearest], face, np.full(widths.shape, 0.8, np.float32),
        np.tile(np.array(color, np.float32), (count, 1)), np.full((count, 4), 0.6, np.float32),
    )  # fmt: skip
