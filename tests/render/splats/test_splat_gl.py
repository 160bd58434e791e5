"""The renderers against the reference, on EGL and on OSMesa, and at the edges of their input."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scenes import head_scene, join, psnr_db, single, take

from render.cameras import portrait
from render.gl.contexts import ContextLostError
from render.splats.reference import ReferenceRenderer
from render.splats.renderer import create_renderer
from render.types import Gaussians
from sensors.types import InputError

CAMERAS = [portrait(256, 256), portrait(203, 131, yaw_deg=35.0, pitch_deg=-10.0)]
# 8-bit rounding alone costs 58.9 dB; quads add the rounding of half floats, once a splat.
MIN_PSNR_DB = {"tiles": 55.0, "quads": 45.0}
# Levels of 255; with hundreds of layers over a pixel the half floats of the quads reach 2.5.
MAX_ERROR = {"tiles": 2.0, "quads": 3.0}
MAX_MISMATCH_RATIO = 0.001  # of pixels that are off by more than that
ROOT = Path(__file__).parents[3]


def expected(gaussians: Gaussians, camera):
    reference = ReferenceRenderer()
    reference.draw(gaussians, camera)
    return 255.0 * reference.read_float()


def draw(renderer, gaussians: Gaussians, camera):
    renderer.draw(gaussians, camera)
    return renderer.read_rgba().copy()


def check(renderer, gaussians: Gaussians, camera):
    picture, truth = draw(renderer, gaussians, camera), expected(gaussians, camera)
    assert picture.shape == (camera.height, camera.width, 4) and picture.dtype == np.uint8
    method = renderer.name.split()[0]
    assert psnr_db(picture, truth) >= MIN_PSNR_DB[method]
    # Depths that are equal in float32 (7.6e-6 mm apart in one scene) may swap two splats: 5 / 255.
    assert np.mean(np.abs(picture - truth).max(axis=2) > MAX_ERROR[method]) <= MAX_MISMATCH_RATIO
    return picture


@pytest.mark.parametrize("camera", CAMERAS)
def test_head_equals_reference(gl_renderer, camera):
    picture = check(gl_renderer, head_scene(4000), camera)
    assert picture[..., 3].max() > 250 and picture[0, 0, 3] == 0  # a head over the background


@pytest.mark.slow
def test_osmesa_equals_reference_and_egl(tiles, tmp_path):
    """OSMesa runs in its own process: two GL libraries in one do not mix."""
    out = tmp_path / "osmesa.npy"
    script = (
        "import sys, numpy as np; sys.path.insert(0, 'tests/render')\n"
        "from scenes import head_scene; from render.cameras import portrait\n"
        "from render.splats.renderer import create_renderer\n"
        "renderer = create_renderer('osmesa', 'tiles')\n"
        "renderer.draw(head_scene(4000), portrait(256, 256))\n"
        f"np.save({str(out)!r}, renderer.read_rgba())\n"
        "assert renderer.name.endswith('(osmesa)'), renderer.name\n"
        "renderer.close()\n"
    )
    environment = {k: v for k, v in os.environ.items() if k != "DISPLAY"}
    environment["PYTHONPATH"] = str(ROOT)
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    picture = np.load(out)
    assert psnr_db(picture, expected(head_scene(4000), portrait(256, 256))) >= 55.0
    assert psnr_db(picture, draw(tiles, head_scene(4000), portrait(256, 256))) >= 70.0


def test_order_of_the_gaussians_does_not_matter(gl_renderer):
    scene, camera = head_scene(2000), portrait(128, 128, yaw_deg=10.0)
    shuffled = take(scene, np.random.default_rng(1).permutation(len(scene)))
    assert (draw(gl_renderer, scene, camera) == draw(gl_renderer, shuffled, camera)).all()


def test_same_input_gives_the_same_picture_twice(gl_renderer):
    scene, camera = head_scene(2000), portrait(128, 128)
    first = draw(gl_renderer, scene, camera)
    draw(gl_renderer, head_scene(500, seed=3), portrait(40, 200))
    assert (draw(gl_renderer, scene, camera) == first).all()


def test_nothing_of_the_last_picture_stays(gl_renderer):
    scene, camera = head_scene(800), portrait(96, 96)
    moved = replace(scene, means=scene.means + np.array([120.0, 60.0, 0.0], np.float32))
    behind = replace(scene, means=scene.means + np.array([0.0, 0.0, 5000.0], np.float32))
    for shown in (scene, moved, scene):
        check(gl_renderer, shown, camera)
    assert (draw(gl_renderer, behind, camera)[..., 3] == 0).all()
    check(gl_renderer, moved, replace(camera, background=(0.9, 0.1, 0.5)))


def test_gaussians_behind_or_too_near_are_not_drawn(gl_renderer):
    camera = replace(portrait(96, 96, distance_mm=300.0), near_mm=280.0)
    scene = head_scene(1500)
    z = scene.means @ camera.viewmat[2, :3] + camera.viewmat[2, 3]
    assert 0 < np.count_nonzero(z < 280.0) < len(scene)
    check(gl_renderer, scene, camera)
    behind = take(scene, np.flatnonzero(z < 280.0))
    assert (draw(gl_renderer, behind, camera)[..., 3] == 0).all()


def test_camera_inside_the_head(gl_renderer):
    check(gl_renderer, head_scene(1500), portrait(96, 96, distance_mm=20.0))


def test_huge_thin_and_outside_gaussians(gl_renderer):
    thin = single((10.0, 10.0, 0.0), 1.0, 0.9, (1.0, 0.2, 0.1))
    thin = replace(
        thin,
        scales=np.array([[120.0, 0.1, 0.1]], np.float32),
        quats=np.array([[0.9, 0.1, 0.2, 0.4]], np.float32),
    )
    outside = single((400.0, 15.0, 0.0), 150.0, 0.9, (0.1, 0.9, 0.2))
    check(gl_renderer, join(thin, outside), portrait(150, 90))


def test_opaque_gaussian_reaches_the_largest_alpha(gl_renderer):
    check(gl_renderer, single((0.0, 15.0, 0.0), 30.0, 1.0, (1.0, 1.0, 1.0)), portrait(65, 65))


def test_no_gaussians_give_the_background(gl_renderer):
    empty = take(head_scene(10), np.zeros(0, int))
    for scene in (empty, single((0.0, 0.0, 1e5), 1.0, 0.5, (1.0, 1.0, 1.0))):
        picture = draw(gl_renderer, scene, portrait(33, 17, background=(0.2, 0.4, 0.6)))
        assert (picture == (51, 102, 153, 0)).all()


def test_nan_gaussians_do_not_spread(gl_renderer):
    scene, camera = head_scene(500), portrait(64, 64)
    poison = single((np.nan, 0.0, 0.0), 5.0, 1.0, (1.0, 0.0, 0.0))
    assert (
        draw(gl_renderer, join(scene, poison), camera) == draw(gl_renderer, scene, camera)
    ).all()


def test_broken_gaussians_are_dropped_and_counted(gl_renderer):
    """NaN, infinite, without size, without rotation, transparent: as many in the reference."""
    scene, camera = head_scene(500), portrait(64, 64)
    good = single((0.0, 0.0, 0.0), 5.0, 1.0, (1.0, 0.0, 0.0))
    broken = [
        replace(good, colors=np.array([[np.nan, 0.0, 0.0]], np.float32)),
        replace(good, means=np.array([[0.0, np.inf, 0.0]], np.float32)),
        replace(good, scales=np.zeros((1, 3), np.float32)),
        replace(good, scales=np.array([[5.0, -1.0, 5.0]], np.float32)),
        replace(good, quats=np.zeros((1, 4), np.float32)),
        replace(good, opacities=np.array([0.001], np.float32)),
        replace(good, opacities=np.array([np.nan], np.float32)),
    ]
    clean = draw(gl_renderer, scene, camera)
    assert gl_renderer.dropped == 0
    assert (draw(gl_renderer, join(scene, *broken), camera) == clean).all()
    reference = ReferenceRenderer()
    reference.draw(join(scene, *broken), camera)
    assert gl_renderer.dropped == reference.dropped == len(broken)


def test_too_many_pairs_are_refused_before_memory_is_taken(tiles):
    scene = head_scene(3000)
    scene = replace(scene, scales=np.full_like(scene.scales, 900.0))
    with pytest.raises(InputError, match=r"at most \d+ \(splat, tile\) pairs, got"):
        draw(tiles, scene, portrait(1024, 1024))
    check(tiles, head_scene(500), portrait(64, 64))


def test_two_renderers_in_one_process(tiles):
    other = create_renderer("egl", "tiles")
    scene, camera = head_scene(800), portrait(96, 96)
    first = draw(tiles, scene, camera)
    check(other, head_scene(300, seed=2), portrait(40, 40))
    assert (draw(tiles, scene, camera) == first).all()
    assert (draw(other, scene, camera) == first).all()
    other.close()
    assert (draw(tiles, scene, camera) == first).all()


def test_a_lost_context_is_replaced_and_the_picture_drawn_again():
    renderer, scene, camera = create_renderer("egl", "quads"), head_scene(500), portrait(64, 64)
    first = draw(renderer, scene, camera)
    lost = renderer._inner._context
    lost.check_errors = lambda where: (_ for _ in ()).throw(ContextLostError(where))
    assert (draw(renderer, scene, camera) == first).all()
    assert renderer.recoveries == 1
    assert (draw(renderer, scene, camera) == first).all()
    assert renderer.recoveries == 1
    renderer.close()


def test_resize_up_and_down(gl_renderer):
    scene = head_scene(800)
    for size in ((64, 64), (200, 120), (31, 77), (64, 64)):
        check(gl_renderer, scene, portrait(*size))


def test_large_picture_needs_wide_sort_keys(tiles):
    """2048 x 2048 px have 2^16 tiles; with more than 2^16 splats 32-bit keys overflow."""
    filler = take(head_scene(70_000), np.arange(70_000))
    filler = replace(filler, scales=np.full_like(filler.scales, 0.05))
    scene = join(head_scene(300), filler)
    picture = draw(tiles, scene, portrait(2048, 2048))
    small = draw(tiles, scene, portrait(512, 512))
    mean = picture.reshape(512, 4, 512, 4, 4).mean(axis=(1, 3))
    assert psnr_db(mean, small) > 25.0


def test_close_twice():
    renderer = create_renderer("auto", "auto")
    assert renderer.name.startswith(("tiles", "quads"))
    renderer.close()
    renderer.close()
