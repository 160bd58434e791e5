"""Both projections give the same splats; the one on the CPU names the tiles they reach, too."""

from dataclasses import replace

import numpy as np
from scenes import head_scene, join, single, take

from render import reference
from render.cameras import portrait
from render.projector import Projector
from render.tile_pairs import deal
from render.tile_projector import TileProjector

CAMERA = portrait(203, 131, yaw_deg=35.0, pitch_deg=-10.0)


def unpacked(words: np.ndarray) -> dict[str, np.ndarray]:
    """As shaders/splat.glsl does it."""
    a, b, c, d = (words[:, k].astype(np.int64) for k in range(4))
    bits = {
        "p": ((a & 0xFFFF) << 12) + (97 << 23),
        "q": ((a >> 16 & 0x7FFF) << 12) + (114 << 23),
        "r": ((b & 0xFFFF) << 12) + (97 << 23),
    }
    fields = {k: v.astype(np.uint32).view(np.float32) for k, v in bits.items()}
    fields["q"] = np.where(a >> 31, -fields["q"], fields["q"])
    fields |= {"x": (c >> 12) / 128 - 2048, "y": (d >> 12) / 128 - 2048, "faint": b >> 16 & 1023}
    blue = b >> 26 << 4 | (c & 3) << 2 | d & 3
    return fields | {"red": c >> 2 & 1023, "green": d >> 2 & 1023, "blue": blue}


def hard_scene():
    """A head, and what is behind, outside, huge, or broken."""
    far = single((900.0, 15.0, 0.0), 150.0, 0.9, (0.1, 0.9, 0.2))
    behind, huge = replace(far, means=far.means * 0 + 5e3), replace(far, scales=far.scales * 9)
    return join(head_scene(3000), far, behind, huge, replace(far, quats=far.quats * np.nan))


def test_both_projections_give_the_same_splats(egl_context):
    scene, on_gpu, on_cpu = hard_scene(), Projector(egl_context.gl), TileProjector()
    orders = [np.sort(projector.run(scene, CAMERA)) for projector in (on_gpu, on_cpu)]
    assert np.array_equal(*orders) and len(orders[0]) > 1000
    assert on_gpu.dropped == on_cpu.dropped == 1
    words = np.empty((len(scene), 4), np.uint32)
    on_gpu.splats.read(words)
    ours, theirs = (unpacked(w[orders[0]]) for w in (on_cpu.splats, words))
    for name, tolerance in {"x": 1 / 128, "y": 1 / 128, "faint": 1, "red": 1, "blue": 1}.items():
        assert np.abs(ours[name] - theirs[name]).max() <= tolerance, name
    for name in "pqr":  # 11 bits of mantissa
        np.testing.assert_allclose(ours[name], theirs[name], rtol=1e-3, atol=2e-3, err_msg=name)


def test_the_order_is_that_of_depth():
    scene = hard_scene()
    order = TileProjector().run(scene, CAMERA)
    depths = scene.means[order] @ CAMERA.viewmat[2, :3]
    assert (np.diff(depths) >= -1e-3).all()


def test_a_splat_is_dealt_to_the_tiles_that_its_pixels_lie_in_and_to_few_others():
    scene, size = take(head_scene(3000), np.arange(0, 3000, 15)), (26, 17)
    scene = replace(scene, scales=scene.scales * np.float32(2.5))
    projector = TileProjector()
    order = projector.run(scene, CAMERA)
    pairs = deal(projector.boxes, order, size, projector.rows)
    dealt = np.zeros((len(scene), size[0] * size[1]), np.bool_)
    dealt[pairs.splats, np.repeat(np.arange(size[0] * size[1]), np.diff(pairs.starts))] = True
    seen = np.zeros_like(dealt)
    for index in range(len(scene)):
        splat = reference.project(take(scene, np.array([index])), CAMERA)
        _, coverage = reference.blend(splat, CAMERA)
        y, x = np.nonzero(coverage)
        seen[index, y // 8 * size[0] + x // 8] = True
    assert seen.sum() > 1000
    assert not (seen & ~dealt).any()
    assert dealt.sum() <= 1.05 * seen.sum()
