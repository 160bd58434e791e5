"""What the projection keeps, in which order, and the tiles that it names."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import head_scene, join, single, take

from render.cameras import portrait
from render.splats import projection, reference
from render.splats.depth_order import DepthOrder
from render.splats.projection_kernels import BROKEN, HIDDEN
from render.splats.projector import Projector
from render.splats.reach_kernels import FURTHER, WHOLE
from render.splats.tile_pairs import bin_splats
from sensors.threads import Threads

CAMERA = portrait(203, 131, yaw_deg=35.0, pitch_deg=-10.0)


def hard_scene():
    """A head, and what is behind, outside, huge, or broken."""
    far = single((900.0, 15.0, 0.0), 150.0, 0.9, (0.1, 0.9, 0.2))
    behind, huge = replace(far, means=far.means * 0 + 5e3), replace(far, scales=far.scales * 9)
    return join(head_scene(3000), far, behind, huge, replace(far, quats=far.quats * np.nan))


def test_the_order_is_that_of_depth():
    scene = hard_scene()
    projector = Projector(Threads())
    order = projector.run(scene, CAMERA)
    assert projector.dropped == 1 and 1000 < len(order) < len(scene) - 2
    depths = scene.means[order] @ CAMERA.viewmat[2, :3]
    assert (np.diff(depths) >= -1e-3).all()


def test_runs_that_nobody_sees_are_left_out_and_counted():
    """As skin under hair; what is seen beside them is where and as it was."""
    scene, clear = head_scene(9000), np.zeros(9000, np.float32)
    shown = np.r_[slice(700, 1900), slice(4000, 8900)]
    clear[shown] = scene.opacities[shown]
    clear[4100], clear[3] = 0, np.nan
    slices = projection.shown_slices(clear, 2048)
    inside = np.concatenate([np.arange(*one) for one in slices])
    assert len(np.unique(inside)) == len(inside) < 7200 and np.isin(shown, inside).all()
    assert all(last - first <= 2048 for first, last in slices)
    veiled, projector = replace(scene, opacities=clear), Projector(Threads())
    order = projector.run(veiled, CAMERA)
    assert projector.dropped == np.count_nonzero(~reference.sound(veiled))
    alone = take(scene, kept := np.setdiff1d(shown, [4100]))
    np.testing.assert_array_equal(order, kept[Projector(Threads()).run(alone, CAMERA)])
    assert projector.run(scene, CAMERA).size > order.size and projector.dropped == 0


def test_equal_depths_keep_their_order_and_close_ones_are_told_apart():
    rng = np.random.default_rng(0)
    depths = rng.choice(rng.uniform(700, 1100, 300).astype(np.float32), 5000)
    depths[::7], depths[5] = HIDDEN, BROKEN
    order = DepthOrder()
    expected = np.argsort(depths, kind="stable")[: np.count_nonzero(depths < HIDDEN)]
    np.testing.assert_array_equal(order.of(depths), expected)
    far = np.append(depths, np.float32(1e7))  # a wide cloud: steps of far below a millimetre
    assert (np.diff(far[order.of(far)]) > -0.05).all()
    assert len(order.of(np.full(3, HIDDEN))) == 0


@pytest.mark.slow
def test_a_splat_is_dealt_to_the_tiles_that_its_pixels_lie_in_and_to_few_others():
    scene, size = take(head_scene(3000), np.arange(0, 3000, 15)), (26, 17)
    wider = np.where(np.arange(len(scene)) % 50, 2.5, 12).astype(np.float32)
    scene = replace(scene, scales=scene.scales * wider[:, None])
    projector = Projector(Threads())
    order, reaches = projector.run_for_tiles(scene, CAMERA, np.empty((len(scene), 9), np.float32))
    large = reaches.words[order] == WHOLE, reaches.words[order] >= FURTHER
    assert large[0].any() and large[1].any() and not np.all(large[0] | large[1])
    pairs = bin_splats(projector.boxes, order, size, reaches)
    dealt = np.zeros((len(scene), size[0] * size[1]), np.bool_)
    for tile, (start, count) in enumerate(zip(pairs.starts[:-2], pairs.counts, strict=True)):
        dealt[pairs.splats[start : start + count], tile] = True
    seen = np.zeros_like(dealt)
    for index in range(len(scene)):
        splat = reference.project(take(scene, np.array([index])), CAMERA)
        _, coverage = reference.blend(splat, CAMERA)
        y, x = np.nonzero(coverage)
        seen[index, y // 8 * size[0] + x // 8] = True
    assert seen.sum() > 1000
    assert not (seen & ~dealt).any()
    assert dealt.sum() <= 1.05 * seen.sum()


def test_a_lobe_shines_where_the_lamp_mirrors():
    """Towards the viewer that the key light mirrors to, and to nobody behind; colours stay."""
    from render.lighting import KEY, STUDIO
    from render.splats.shine import colors_from
    from render.types import Gaussians, Shine

    normal = KEY.towards + (0, 0, 1)
    normal = (normal / np.linalg.norm(normal)).astype(np.float32)
    quats = np.array([[1.0001 + normal[2], -normal[1], normal[0], 0]] * 2, np.float32)
    means, ones = np.zeros((2, 3), np.float32), np.ones((2, 3), np.float32)
    weights = np.array([[1, 1, 1, 1]], np.float32)
    shine = Shine(weights, np.array([0.3], np.float32), STUDIO.colors)
    cloud = Gaussians(means, quats, ones, ones[:, 0], 0.3 * ones, shine)
    ahead, side, behind = (
        colors_from(cloud, np.array(at)) for at in ((0, 0, 900), (600, 0, 670), (0, 0, -900))
    )
    assert ahead[0].min() > 0.45 and ahead[0].mean() > side[0].mean() + 0.1
    np.testing.assert_allclose(behind, 0.3)
    np.testing.assert_allclose(ahead[1], 0.3)  # only the first has a lobe
    np.testing.assert_array_equal(cloud.colors, 0.3 * ones)


def test_one_thread_draws_what_all_draw(tiles, monkeypatch):
    scene, camera = head_scene(2000), portrait(203, 131, yaw_deg=20.0)
    tiles.draw(scene, camera)
    picture = tiles.read_rgba().copy()
    monkeypatch.setattr(tiles._threads, "count", 1)
    tiles.draw(scene, camera)
    assert (tiles.read_rgba() == picture).all()
