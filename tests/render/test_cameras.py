"""Portrait cameras: where points land."""

import numpy as np
import pytest

from render.cameras import PORTRAIT_SPAN_MM, portrait
from render.errors import InputError


def pixel(camera, point):
    in_camera = camera.viewmat[:3, :3] @ np.asarray(point) + camera.viewmat[:3, 3]
    return (camera.K @ in_camera / in_camera[2])[:2], in_camera[2]


@pytest.mark.parametrize("yaw,pitch", [(0.0, 0.0), (30.0, 0.0), (-50.0, 20.0)])
def test_target_is_centred_at_the_distance(yaw, pitch):
    camera = portrait(320, 200, yaw, pitch, distance_mm=700.0, target_mm=(5.0, 6.0, 7.0))
    xy, depth = pixel(camera, (5.0, 6.0, 7.0))
    assert xy == pytest.approx((160.0, 100.0))
    assert depth == pytest.approx(700.0)
    rotation = camera.viewmat[:3, :3]
    assert rotation @ rotation.T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0)


def test_yaw_moves_the_camera_to_the_subjects_left_and_pitch_up():
    def position(camera):
        return -camera.viewmat[:3, :3].T @ camera.viewmat[:3, 3]

    assert position(portrait(8, 8, yaw_deg=30.0))[0] > 0.0
    assert position(portrait(8, 8, pitch_deg=30.0))[1] > 100.0


def test_head_fills_the_same_span_at_any_distance():
    for distance in (400.0, 1500.0):
        camera = portrait(512, 512, distance_mm=distance)
        top, _ = pixel(camera, (0.0, 15.0 + PORTRAIT_SPAN_MM / 2, 0.0))
        assert top == pytest.approx((256.0, 0.0), abs=1e-9)


@pytest.mark.parametrize("kwargs", [{"pitch_deg": 90.0}, {"distance_mm": 0.0}])
def test_impossible_cameras_are_input_errors(kwargs):
    with pytest.raises(InputError, match="expected"):
        portrait(64, 64, **kwargs)
    with pytest.raises(InputError, match="0x64"):
        portrait(0, 64)
