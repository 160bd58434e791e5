"""Which rows of a tile a splat is blended in, and what becomes of the pixels there."""

import numpy as np
from numba import njit

from render.splats.projection_kernels import FAINTEST
from render.splats.row_kernels import KEPT, NUMBERS, ROWS, blend_rows, reach_rows

LEFT, TOP = np.float32(16.5), np.float32(40.5)  # px, the middle of the tile's first pixel


@njit
def rows_of(splats, left, top, work):
    bits = np.empty(len(splats), np.uint8)
    for i in range(len(splats)):
        bits[i] = reach_rows(splats, np.uintp(i), left, top, work, np.uintp(KEPT * i))
    return bits


@njit
def blend_all(tile, row, work, places):
    blend_rows(tile, np.uintp(row), work, places, np.uintp(len(places)))


def random_splats(count):
    rng = np.random.default_rng(3)
    splats = np.zeros((count, NUMBERS), np.float32)
    splats[:, :2] = rng.uniform((8, 32), (32, 56), (count, 2))
    splats[:, 2], splats[:, 4] = rng.uniform(0.1, 2, (2, count))
    splats[:, 3] = rng.uniform(-1, 1, count)
    splats[:, 5] = rng.uniform(-5, 0, count)
    splats[:, 6:9] = rng.uniform(0, 1, (count, 3))
    return splats


def powers(splats):
    """[N, 8, 8] log2 of alpha at the tile's pixels."""
    x, y, p, q, r, log2_opacity = splats[:, :6, None, None].astype(np.float64).transpose(1, 0, 2, 3)
    columns, rows = np.arange(8)[None, None] + LEFT - x, np.arange(8)[None, :, None] + TOP - y
    return log2_opacity - (p * columns + q * rows) ** 2 - (r * rows) ** 2


def test_rows_that_show_a_splat_are_reached_and_few_others():
    splats = random_splats(2000)
    bits = rows_of(splats, LEFT, TOP, np.zeros(KEPT * len(splats), np.float32))
    reached = (bits[:, None] >> np.arange(8) & 1).astype(bool)
    shown = (powers(splats) >= -float(FAINTEST)).any(2)
    assert shown.any() and not shown.all()
    assert not (shown & ~reached).any()
    assert reached.sum() < 1.2 * shown.sum()  # between two pixels it may be nearer than at them


def test_two_rows_are_blended_front_to_back_and_no_others():
    splats = random_splats(40)
    work, row = np.zeros(KEPT * len(splats), np.float32), 4
    rows_of(splats, LEFT, TOP, work)
    tile = np.zeros((4, 8, 8), np.float32)
    tile[0] = 1
    blend_all(tile.reshape(-1), row, work, KEPT * np.arange(len(splats), dtype=np.uint32))
    alphas = np.where(powers(splats) >= -float(FAINTEST), 2 ** powers(splats), 0)
    expected = np.zeros((4, 8, 8))
    expected[0] = 1
    for alpha, color in zip(alphas, splats[:, 6:9], strict=True):
        weight = alpha * expected[0]
        expected[0] -= weight
        expected[1:] += weight * color[:, None, None]
    here = slice(row, row + ROWS)
    assert np.abs(tile[:, here] - expected[:, here]).max() < 1e-3
    tile[:, here] = 0
    assert (tile[0].sum(), tile[1:].sum()) == (8 * (8 - ROWS), 0)
