"""Splats are dealt to tiles in the order of depth, as far as their rows say."""

import numpy as np

from render.splats.reach_kernels import FURTHER, WHOLE
from render.splats.tile_kernels import blended_tiles
from render.splats.tile_pairs import Reaches, bin_splats


def boxes_of(corners):
    x0, y0, x1, y1 = np.array(corners, np.uint32).T
    return np.stack([x0 | y0 << 16, x1 | y1 << 16], 1)


def lists(pairs):
    starts = pairs.starts[: len(pairs.counts)]
    return [list(pairs.splats[a : a + n]) for a, n in zip(starts, pairs.counts, strict=True)]


def first_to_last(count):
    return np.arange(count, dtype=np.uint32)


def test_boxes_reach_every_tile_of_theirs_nearest_first():
    pairs = bin_splats(
        boxes_of([(1, 0, 3, 2), (0, 0, 2, 1), (2, 1, 3, 2)]), first_to_last(3), (3, 2)
    )
    assert lists(pairs) == [[1], [0, 1], [0], [], [0], [0, 2]]


def test_lists_hold_the_numbers_of_those_in_the_order():
    boxes = boxes_of([(0, 0, 2, 1), (0, 0, 1, 1), (1, 0, 2, 1)])
    pairs = bin_splats(boxes, np.array([2, 0], np.uint32), (2, 1))
    assert lists(pairs) == [[0], [2, 0]]


def reach(first_tile, *rows):
    """Of rows that leave out some tiles, then reach some."""
    bits = sum((left << 4 | n) << 8 * k for k, (left, n) in enumerate(rows))
    further = int(FURTHER) if len(rows) > 4 else 0
    return further | first_tile << 32 | bits & 0xFFFFFFFF, bits >> 32


def test_rows_leave_out_what_the_ellipse_misses():
    diamond, _ = reach(0, (1, 1), (0, 3), (1, 1))
    reaches = Reaches(np.array([diamond, WHOLE], np.uint64), np.zeros(2, np.uint32))
    pairs = bin_splats(boxes_of([(0, 0, 3, 3), (2, 2, 3, 3)]), first_to_last(2), (3, 3), reaches)
    assert lists(pairs) == [[], [0], [], [0], [0], [0], [], [0], [1]]
    assert pairs.starts[-1] - pairs.starts[-2] == 1  # the list of no tile is empty


def test_rows_below_the_fourth_lie_beside_the_reach():
    rows = [(0, 0), (0, 5), (2, 1), (0, 0), (1, 2), (0, 15)]
    word, further = reach(0, *rows)
    reaches = Reaches(np.array([word], np.uint64), np.array([further], np.uint32))
    pairs = bin_splats(boxes_of([(0, 0, 15, 6)]), first_to_last(1), (16, 6), reaches)
    reached = np.zeros((6, 16), int)
    for y, (left, n) in enumerate(rows):
        reached[y, left : left + n] = 1
    assert [len(found) for found in lists(pairs)] == list(reached.ravel())


def test_random_boxes_equal_a_loop():
    rng = np.random.default_rng(0)
    low = rng.integers(0, 30, (500, 2))
    high = low + rng.integers(1, 12, (500, 2))
    expected = [[] for _ in range(42 * 42)]
    for m, ((x0, y0), (x1, y1)) in enumerate(zip(low, high, strict=True)):
        for y in range(y0, y1):
            for x in range(x0, x1):
                expected[y * 42 + x].append(m)
    assert lists(bin_splats(boxes_of(np.c_[low, high]), first_to_last(500), (42, 42))) == expected


def test_no_splats_give_empty_lists():
    assert lists(bin_splats(np.zeros((0, 2), np.uint32), first_to_last(0), (2, 2))) == [
        [],
        [],
        [],
        [],
    ]


def test_tiles_are_blended_where_splats_are_and_where_some_were():
    near = bin_splats(boxes_of([(0, 0, 1, 1)]), first_to_last(1), (3, 2))
    far = bin_splats(boxes_of([(1, 1, 3, 2)]), first_to_last(1), (3, 2))
    covered = np.zeros(6, np.bool_)
    assert list(blended_tiles((near.starts, far.starts), covered)) == [0, 4, 5]
    assert list(np.flatnonzero(covered)) == [0, 4, 5]
    assert list(blended_tiles((near.starts,), covered)) == [0, 4, 5]
    assert list(blended_tiles((near.starts,), covered)) == [0]
