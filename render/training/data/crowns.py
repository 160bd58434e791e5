"""Shapes of teeth and gums: nearly rectangular crowns that touch, gums that end in shallow arcs.

The face data's teeth narrow from their biting edge to the root, its gums come down to half of the
crowns between them. That is seen on teeth laid bare; where lips cover the edges, what is left to
see are fangs. So crowns stay wide up to the gum, and gums go back between them.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from render.types import Floats, Ints

Indices = NDArray[np.intp]
ARCH_MM = 74.0  # z of the middle of the arch of teeth
STEP_MM = 0.5  # at which outlines are measured
CROWN_MM = {"teeth_upper": 11.0, "teeth_lower": 10.0}  # from the edge to the gum
NARROWER = {"teeth_upper": 0.08, "teeth_lower": 0.12}  # a crown at the gum, of its widest part
UPRIGHT = 0.8  # how far a tooth that leans is set upright over its widest part
WIDEST = 1.8  # most that a place on a crown is widened
DIP_MM = 0.7  # of the gum, between two teeth
BEHIND_MM = 1.0  # that it goes in there
REACH_MM = 5.0  # from the edge of the gum up to which it moves
ROUND_MM = 0.5, 2.0  # corners of an edge: how much shorter; height over the edge that moves
SAMPLES = 24  # places a triangle that outlines are measured at


def single(faces: Ints, count: int) -> Ints:  # [F, 3] -> [count]
    """Which connected part of the mesh a vertex belongs to: a tooth is one."""
    rows, columns = faces[:, [0, 1]].ravel(), faces[:, [1, 2]].ravel()
    joined = csr_array((np.ones(len(rows)), (rows, columns)), shape=(count, count))
    return connected_components(joined, directed=False)[1]


def reshaped(
    vertices: Floats,  # [V, 3] mm
    faces: Ints,  # [F, 3]
    regions: dict[str, Ints],
) -> Floats:  # [V, 3] mm
    """The mean face with other teeth and gums."""
    out, part = vertices.copy(), single(faces, len(vertices))
    gums = regions["gums"]
    middle = 0.5 * (
        vertices[regions["teeth_upper"], 1].min() + vertices[regions["teeth_lower"], 1].max()
    )
    for jaw, way in (("teeth_upper", 1), ("teeth_lower", -1)):
        teeth = [np.flatnonzero(part == k) for k in np.unique(part[regions[jaw]])]
        for tooth in teeth:
            out[tooth] = _widened(vertices, faces[np.isin(faces, tooth).all(1)], tooth, jaw, way)
        of_jaw = gums[way * (vertices[gums, 1] - middle) > 0]
        around = np.sort([_along(vertices[tooth].mean(0)[None])[0] for tooth in teeth])
        corners = faces[np.isin(faces, of_jaw).all(1)]
        out[of_jaw] += _moved(vertices, corners, of_jaw, around, way)
    return out


def _widened(vertices: Floats, faces: Ints, tooth: Indices, jaw: str, way: int) -> Floats:
    """[n, 3] mm: a tooth whose crown keeps the width of its widest part."""
    points, centre = vertices[tooth].astype(np.float64), vertices[tooth].mean(0)
    x, z = centre[0], max(centre[2] - ARCH_MM, 0)
    across = np.array([z, 0, -x]) / np.hypot(x, z)
    dense = _dense(vertices, faces)
    edge = (way * dense[:, 1]).min()
    rows = ((way * dense[:, 1] - edge) / STEP_MM).astype(int)
    side = (dense - centre) @ across
    low, high = (np.full(rows.max() + 1, np.nan) for _ in range(2))
    for row in np.unique(rows):
        low[row], high[row] = side[rows == row].min(), side[rows == row].max()
    heights = STEP_MM * (np.arange(len(low)) + 0.5)
    known = np.isfinite(low)
    low, high = (np.interp(heights, heights[known], x[known]) for x in (low, high))
    width, crown = high - low, CROWN_MM[jaw]
    widest = int(np.where(heights < 0.7 * crown, width, 0).argmax())
    share = np.clip((heights - heights[widest]) / (crown - heights[widest]), 0, 1)
    wanted = width[widest] * (1 - NARROWER[jaw] * share**2)
    gain = np.where(np.arange(len(width)) > widest, np.clip(wanted / width, 1, WIDEST), 1)
    up = way * points[:, 1] - edge
    middle, gain = np.interp(up, heights, 0.5 * (low + high)), np.interp(up, heights, gain)
    straight = np.interp(up, heights, (np.arange(len(width)) > widest).astype(float))
    aim = middle + UPRIGHT * straight * (0.5 * (low + high)[widest] - middle)
    moved = aim + gain * ((points - centre) @ across - middle)
    out = points + (moved - (points - centre) @ across)[:, None] * across
    beside = np.abs(moved - aim) / np.abs(moved - aim)[up < ROUND_MM[1]].max()
    out[:, 1] += way * ROUND_MM[0] * np.clip(1 - up / ROUND_MM[1], 0, 1) * beside**3
    return out.astype(np.float32)


def _moved(
    vertices: Floats,
    faces: Ints,  # [n, 3] of the gum
    gum: Ints,  # [g] vertices
    around: NDArray[np.floating],  # [t] mm along the arch: middles of the teeth, rising
    way: int,
) -> Floats:  # [g, 3] mm
    """How gum goes back, so that between two teeth it ends DIP_MM further than on them, and lies
    behind their sides."""
    dense = _dense(vertices, faces)
    places = np.arange(around[0], around[-1], STEP_MM)
    at, up = _along(dense), way * dense[:, 1]
    edge = np.array([up[np.abs(at - place) < STEP_MM].min(initial=np.inf) for place in places])
    known = np.isfinite(edge)
    edge = np.interp(places, places[known], edge[known])
    highest = np.array([edge[np.abs(places - tooth) < 2].max() for tooth in around])
    between = np.interp(places, around, np.arange(len(around)))
    off = 2 * np.abs(between - np.rint(between))
    wanted = np.interp(places, around, highest) - DIP_MM * off**2
    own, height = _along(vertices[gum]), way * vertices[gum, 1]
    first = np.interp(own, places, edge)
    by = np.interp(own, places, np.maximum(wanted - edge, 0), left=0, right=0)
    deep = BEHIND_MM * np.interp(own, places, off**2, left=0, right=0)
    inward = vertices[gum] - (0, 0, ARCH_MM)
    inward[:, 1], inward[:, 2] = 0, np.maximum(inward[:, 2], 0)
    inward /= -np.linalg.norm(inward, axis=1, keepdims=True) - 1e-6
    near = np.exp(-((np.maximum(height - first, 0) / REACH_MM) ** 2))
    moves = deep[:, None] * inward + by[:, None] * np.array([0, way, 0])
    return (near[:, None] * moves).astype(np.float32)


def _along(points: NDArray[np.floating]) -> NDArray[np.floating]:  # [n, 3] mm -> [n] mm
    """Place along the arch: around its middle in front, straight back from there."""
    x, z = points[:, 0].astype(np.float64), points[:, 2] - ARCH_MM
    radius = 27.0
    return np.where(z > 0, radius * np.arctan2(x, z), np.sign(x) * (0.5 * np.pi * radius - z))


def _dense(vertices: Floats, faces: Ints) -> NDArray[np.float64]:  # [F * SAMPLES, 3]
    """Places on triangles, always the same ones."""
    shares = np.random.default_rng(0).dirichlet((1, 1, 1), SAMPLES)
    return np.einsum("sk,fkc->fsc", shares, vertices[faces].astype(np.float64)).reshape(-1, 3)
