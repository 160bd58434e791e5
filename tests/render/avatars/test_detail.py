"""Colours that together show a texture: what is seen of overlapping Gaussians, and its inverse."""

import numpy as np
from scipy.sparse import csr_array, eye_array

from render.avatars import blends, detail, textures

STEP_MM, SIDE = 1.0, 24  # a flat sheet of Gaussians that faces the viewer


def sheet() -> blends.Drawn:
    """Narrow Gaussians on a grid, 1 mm below them a wide one under every fourth."""
    at = np.arange(SIDE) * STEP_MM
    x, y = (v.ravel() for v in np.meshgrid(at, at))
    above = np.stack([x, y, np.zeros_like(x)], 1)
    wide = above[(x % 2 == 0) & (y % 2 == 0)] - np.array([0, 0, 1.0])
    points = np.concatenate([above, wide]).astype(np.float32)
    below = points[:, 2] < 0
    return blends.Drawn(
        points,
        np.tile(np.array([0, 0, 1], np.float32), (len(points), 1)),
        np.where(below, 1.6, 0.35).astype(np.float32),
        np.full(len(points), 0.8, np.float32),
        below,
    )


def shares_of(drawn: blends.Drawn) -> csr_array:
    """Those below have the mean colour of the four above."""
    above, wide = drawn.points[~drawn.below], drawn.points[drawn.below]
    off = above[None, :, :2] - wide[:, None, :2]
    mean = ((off >= 0) & (off < 2 * STEP_MM)).all(2)
    mean = mean / mean.sum(1, keepdims=True)
    return csr_array(np.concatenate([eye_array(len(above)).toarray(), mean]))


def test_front_covers_what_is_behind():
    drawn = sheet()
    place = drawn.points[:1] + np.array([[0.1, 0.0, 0.0]], np.float32)
    wide = int(np.flatnonzero(drawn.below)[0])
    near = np.array([[wide, 0], [wide, 0]], np.int32)  # the one below given first
    places = np.concatenate([place, place + 20])  # and one that neither covers
    facing, towards = np.arange(2), np.array([0, 0, 1], np.float32)
    seen, whole = blends.composited(drawn, near, facing, places, towards)
    assert whole.tolist() == [True, False] and near[0].tolist() == [0, wide]
    share = seen.toarray()[0]
    assert share[0] > 0.7 and share[wide] > 0.05 and abs(share.sum() - 1) < 1e-6


def test_a_sheet_shows_its_texture_in_its_own_hue():
    drawn, rng = sheet(), np.random.default_rng(1)
    above = drawn.points[~drawn.below]
    low, high = 4, SIDE - 4  # away from the edge of the sheet
    points = np.zeros((4000, 3), np.float32)
    points[:, :2] = rng.uniform(low, high, (4000, 2))
    normals = np.tile(np.array([0, 0, 1], np.float32), (len(points), 1))
    uv = (points[:, :2] / SIDE).astype(np.float32)
    coarse = textures.soft(rng.random((96, 192, 1)).astype(np.float32), 2.5)
    coarse = 0.5 + 0.03 * (coarse - coarse.mean()) / coarse.std()
    skin = np.clip(coarse * np.array([1.2, 0.9, 0.7]), 0, 1).astype(np.float32)
    blend = blends.blend(drawn, shares_of(drawn), points, normals, uv)
    np.testing.assert_allclose(blend.shares.sum(1), 1, atol=1e-5)
    albedo = textures.sample(skin, (above[:, :2] / SIDE).astype(np.float32) * detail.ATLAS)
    free = (above[:, :2] > 2).all(1) & (above[:, :2] < SIDE - 3).all(1)
    seen = textures.sample(skin, blend.uv * detail.ATLAS)
    before = np.abs(blend.shares @ albedo - seen).mean()
    sharp = detail.sharpened(albedo, free, blend, seen)
    assert np.abs(blend.shares @ sharp - seen).mean() < 0.75 * before
    assert (sharp[~free] == albedo[~free]).all()
    inside = (sharp > 0.01).all(1) & (sharp < 0.99).all(1)
    hue = [c[inside] / c[inside].sum(1, keepdims=True) for c in (sharp, albedo)]
    np.testing.assert_allclose(hue[0], hue[1], atol=1e-5)
    again = detail.sharpened(albedo, free, blend, seen)
    assert (again == sharp).all()

    def gains(low: float, high: float) -> np.ndarray:
        return detail.gains(albedo, free, blend, seen, (low, high))

    limits, alone = (0.93, 1.03), gains(0, 9)
    limited, cut = gains(*limits), alone.clip(*limits)
    assert alone.min() < limits[0] and alone.max() > limits[1]  # no grains of salt or soot
    assert limited.min() > limits[0] - 1e-5 and limited.max() < limits[1] + 1e-5
    off = [np.square(blend.shares @ (albedo * g[:, None]) - seen).sum() for g in (limited, cut)]
    assert off[0] < 0.99 * off[1]  # others make up for it


def test_an_eye_keeps_its_own_hues():
    """A dark disc on a red and white ground, on a sheet that blurs it: its rim is seen steeper."""
    drawn = sheet()
    above = drawn.points[~drawn.below]
    points = np.zeros((6000, 3), np.float32)
    points[:, :2] = np.random.default_rng(2).uniform(4, SIDE - 4, (6000, 2))
    normals = np.tile(np.array([0, 0, 1], np.float32), (len(points), 1))

    def ground(at):
        inside = np.hypot(*(at - SIDE / 2).T) < 4
        return np.where(inside[:, None], [0.1, 0.1, 0.1], [0.8, 0.3, 0.3]).astype(np.float32)

    blend = blends.blend(drawn, shares_of(drawn), points, normals, points[:, :2])
    albedo, wanted = ground(above[:, :2]), ground(blend.uv)
    bounds = np.full_like(albedo, 0.05), np.full_like(albedo, 0.9)
    painted = detail.repainted(albedo, np.ones(len(above), bool), blend, wanted, bounds)
    before, after = (np.abs(blend.shares @ c - wanted).mean(0) for c in (albedo, painted))
    assert (after < 0.95 * before).all() and painted.min() > 0.049 and painted.max() < 0.901
    alone = blends.blend(drawn, shares_of(drawn), points, normals, points[:, :2], ~drawn.below)
    wide = shares_of(drawn)[len(above) :].sum(0) > 0
    assert wide.any() and alone.shares.sum(1).max() < 1.001
