"""Teeth of the mean face: crowns stay wide up to the gum, which does not come down between them."""

import numpy as np

from render.training.data import crowns
from render.types import Floats, Ints

MIDDLES, ROWS = (-16.0, -8.0, 0.0, 8.0, 16.0), np.arange(0, 13.0)
ACROSS = np.linspace(-20, 20, 81)


def sheet(grid: Floats, first: int) -> Ints:  # [rows, columns, 3] -> [F, 3]
    rows, columns = grid.shape[:2]
    at = first + np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = at[:-1, :-1], at[:-1, 1:], at[1:, :-1], at[1:, 1:]
    return np.concatenate([np.stack([a, b, c], -1), np.stack([b, d, c], -1)]).reshape(-1, 3)


def jaw(way: int) -> list[Floats]:
    """Teeth that narrow from 8 to 4 mm, and a gum that comes down from 9 to 4 mm between them."""
    half = 4 - ROWS[:, None] / 6
    side = np.linspace(-1, 1, 9)[None]
    height = np.broadcast_to(way * (2 + ROWS[:, None]), (13, 9))
    front = np.full((13, 9), 100.0)
    teeth = [np.stack([x + half * side, height, front], -1) for x in MIDDLES]
    edge = 6.5 + 2.5 * np.cos(2 * np.pi * ACROSS / 8)
    rows = edge + np.arange(0, 8.0)[:, None]
    gum = np.stack([np.tile(ACROSS, (8, 1)), way * (2 + rows), np.full((8, 81), 101.0)], -1)
    return [*teeth, gum]


def test_crowns_are_nearly_rectangular_and_gums_end_in_shallow_arcs() -> None:
    parts = jaw(1) + jaw(-1)
    starts = np.cumsum([0, *(p.shape[0] * p.shape[1] for p in parts)])
    faces = np.concatenate([sheet(p, s) for p, s in zip(parts, starts, strict=False)])
    vertices = np.concatenate([p.reshape(-1, 3) for p in parts]).astype(np.float32)
    rows = [np.arange(a, b) for a, b in zip(starts, starts[1:], strict=False)]
    regions = {
        "teeth_upper": np.concatenate(rows[:5]),
        "teeth_lower": np.concatenate(rows[6:11]),
        "gums": np.concatenate([rows[5], rows[11]]),
    }
    out = crowns.reshaped(vertices, faces.astype(np.int32), regions)
    for first in (0, 6):
        for tooth in rows[first : first + 5]:
            x = out[tooth, 0].reshape(13, 9)
            np.testing.assert_allclose(np.ptp(x[0]), 8, atol=0.3)  # edges stay
            assert np.ptp(x[8]) > 6.4  # was 5.3
            bite = np.abs(out[tooth, 1].reshape(13, 9)[0])
            assert bite[4] < 2.1 and bite[[0, -1]].min() > 2.4  # corners are round
        edge = np.abs(out[rows[first + 5], 1].reshape(8, 81)[0])
        inner = np.abs(ACROSS) < 14
        assert np.ptp(edge[inner]) < 2.2  # was 5
        height = np.abs(out[rows[first + 5], 1].reshape(8, 81))
        assert (np.diff(height, axis=0) > 0).all()  # no gum is folded
