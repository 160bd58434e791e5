"""The reference splatter against formulas worked out by hand."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import join, single

from render.cameras import portrait
from render.splats.reference import LOW_PASS_PX2, ReferenceRenderer
from render.types import Gaussians
from sensors.types import InputError

CAMERA = portrait(65, 65, distance_mm=800.0)  # the target lies in the middle of pixel (32, 32)
TARGET = (0.0, 15.0, 0.0)
FOCAL_PX = CAMERA.K[0, 0]


def draw(gaussians: Gaussians, camera=CAMERA):
    renderer = ReferenceRenderer()
    renderer.draw(gaussians, camera)
    return renderer.read_float()


def test_profile_is_the_projected_gaussian():
    picture = draw(single(TARGET, 10.0, 0.8, (1.0, 0.5, 0.0)))
    variance = (FOCAL_PX / 800.0 * 10.0) ** 2 + LOW_PASS_PX2
    for dx, dy in ((0, 0), (3, 0), (0, -2), (2, 2)):
        alpha = 0.8 * np.exp(-0.5 * (dx * dx + dy * dy) / variance)
        expected = alpha * np.array((1.0, 0.5, 0.0)) + (1.0 - alpha) * 0.16
        assert picture[32 + dy, 32 + dx, :3] == pytest.approx(expected, abs=1e-6)
        assert picture[32 + dy, 32 + dx, 3] == pytest.approx(alpha, abs=1e-6)


def test_nearer_gaussian_covers_the_farther_one():
    near = single((0.0, 15.0, 50.0), 20.0, 1.0, (1.0, 0.0, 0.0))
    far = single((0.0, 15.0, -50.0), 20.0, 1.0, (0.0, 1.0, 0.0))
    for cloud in (join(near, far), join(far, near)):
        assert draw(cloud)[32, 32, :3] == pytest.approx((0.999, 0.001 * 0.999, 0.0), abs=1e-3)


def test_faint_contributions_are_cut_off():
    assert (draw(single(TARGET, 20.0, 0.0035, (1.0, 1.0, 1.0)))[..., 3] == 0.0).all()
    coverage = draw(single(TARGET, 10.0, 0.5, (1.0, 1.0, 1.0)))[..., 3]
    assert coverage[coverage > 0.0].min() >= 1.0 / 255.0


@pytest.mark.slow
def test_a_strand_is_as_dark_from_afar_as_it_is_near():
    """The filter makes a hair wider than it is: it fades by as much. Discs do not."""
    hair = single(TARGET, 0.3, 0.9, (0.0, 0.0, 0.0))
    hair = replace(hair, scales=np.array([[20.0, 0.3, 0.3]], np.float32))
    coarse, fine = (draw(hair, portrait(px, px, distance_mm=800.0)) for px in (260, 2080))
    covered = [(x[..., 3] / x.shape[0] ** 2).sum() for x in (coarse, fine)]
    assert covered[0] == pytest.approx(covered[1], rel=0.1)
    disc = replace(hair, scales=np.array([[0.1, 0.1, 0.01]], np.float32))
    assert draw(disc)[..., 3].max() == pytest.approx(0.9, abs=1e-6)


def test_axes_follow_the_world():
    """+x is the subject's left, on the right of the picture; +y is the top."""
    left = draw(single((40.0, 15.0, 0.0), 5.0, 0.9, (1.0, 1.0, 1.0)))[..., 3]
    top = draw(single((0.0, 80.0, 0.0), 5.0, 0.9, (1.0, 1.0, 1.0)))[..., 3]
    assert left[:, 33:].sum() > 10.0 * left[:, :32].sum()
    assert top[:32].sum() > 10.0 * top[33:].sum()


def test_wrong_shape_is_an_input_error():
    good = single(TARGET, 10.0, 0.8, (1.0, 1.0, 1.0))
    bad = Gaussians(good.means, good.quats[:, :3], good.scales, good.opacities, good.colors)
    with pytest.raises(InputError, match=r"quats: expected shape \[1, 4\], got \[1, 3\]"):
        draw(bad)
