"""Portrait cameras: where points land."""

import numpy as np
import pytest

from render.cameras import PORTRAIT_SPAN_MM, portrait
from sensors.types import InputError


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


def test_an_orbit_turns_zooms_and_moves_the_picture_under_the_hand():
    from render.cameras import HEAD_CENTRE_MM, Orbit

    orbit = Orbit().turned(30.0, 10.0).zoomed(2.0)
    camera = orbit.camera(300, 200)
    assert pixel(camera, HEAD_CENTRE_MM)[0] == pytest.approx((150.0, 100.0))
    assert camera.K[0, 0] == pytest.approx(2.0 * portrait(300, 200).K[0, 0])
    px = orbit.mm_per_px(300, 200)
    moved = orbit.moved(20 * px, 7 * px).camera(300, 200)
    assert pixel(moved, HEAD_CENTRE_MM)[0] == pytest.approx((170.0, 93.0))


def test_an_orbit_stays_in_its_range():
    from render.cameras import MAX_PITCH_DEG, MOVE_RANGE_MM, ZOOM_RANGE, Orbit

    orbit = Orbit().turned(3590.0, 500.0).zoomed(1e9).moved(1e9, -1e9)
    assert orbit.yaw_deg == pytest.approx(-10.0)
    assert orbit.pitch_deg == MAX_PITCH_DEG
    assert orbit.zoom == ZOOM_RANGE[1]
    assert (orbit.right_mm, orbit.up_mm) == (MOVE_RANGE_MM, -MOVE_RANGE_MM)
    orbit.camera(64, 64)
