"""Tight curls, the other way to fill a style: springs in tufts below its hull."""

import numpy as np
from scipy.spatial import KDTree

from render.strands import away
from render.training.geometry.trace import Pieces, strewn
from render.types import Floats

COUNT, TURNS, PIECES = 11_000, 0.95, 5  # springs; turns and pieces of each
RADII_MM, LONG_MM = (0.9, 1.9), (1.2, 3.0)
DEPTHS_MM = -2.5, 4.0  # below the hull
TUFT, ASKEW_MM = 14, 2.5  # springs of one; how uneven tufts make the edge
LIGHTEST, DARKER, LIMITS = 1.05, 0.09, (0.4, 1.3)  # brightness at the hull; a mm below it


def curls(hull: Floats, rng: np.random.Generator) -> Pieces:
    """Below triangles [T, 3, 3] mm."""
    chosen, shares = strewn(hull, COUNT, rng)
    places = (hull[chosen] * shares).sum(1)
    tufts = np.asarray(KDTree(places[: COUNT // TUFT]).query(places)[1])
    outward = away(places.astype(np.float32))
    askew = rng.normal(0, ASKEW_MM, places.shape)[tufts]
    askew -= (askew * outward).sum(1, keepdims=True) * outward
    depth = rng.uniform(*DEPTHS_MM, (COUNT, 1)) * rng.uniform(0.3, 1, (COUNT, 1))
    middle = places + askew - outward * depth
    axis = rng.standard_normal((COUNT, 3))[tufts] + 0.5 * rng.standard_normal((COUNT, 3)) + outward
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    across = np.cross(axis, rng.standard_normal((COUNT, 3)))
    across /= np.linalg.norm(across, axis=1, keepdims=True) + 1e-9
    axis, across, other = axis[:, None], across[:, None], np.cross(axis, across)[:, None]
    radius, long = (rng.uniform(*mm, (COUNT, 1, 1)) for mm in (RADII_MM, LONG_MM))
    at = np.linspace(-0.5, 0.5, PIECES)[:, None]
    turn = 2 * np.pi * TURNS
    sin, cos = np.sin(turn * at), np.cos(turn * at)
    lines = middle[:, None] + radius * (cos * across + sin * other) + long * at * axis
    along = turn * radius * (cos * other - sin * across) + long * axis
    along /= np.linalg.norm(along, axis=2, keepdims=True)
    bright = np.clip(LIGHTEST - DARKER * depth[:, 0], *LIMITS).repeat(PIECES).astype(np.float32)
    middles, along = (x.reshape(-1, 3).astype(np.float32) for x in (lines, along))
    spring = np.arange(COUNT).repeat(PIECES)
    return Pieces(middles, along, bright, np.full_like(bright, 0.5), spring)
