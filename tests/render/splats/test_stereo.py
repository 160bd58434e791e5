"""Stereo cameras: where points land in each eye, and that a pair is two pictures."""

import numpy as np
import pytest
from scenes import head_scene, psnr_db, take

from render.cameras import portrait
from render.splats.reference import ReferenceRenderer
from render.splats.stereo import draw_pair, eye_viewmats, off_axis, side_by_side
from sensors.types import InputError


def pixel(camera, point):
    in_camera = camera.viewmat[:3, :3] @ np.asarray(point, float) + camera.viewmat[:3, 3]
    return (camera.K @ in_camera / in_camera[2])[:2]


def facing_pose(distance_mm: float) -> np.ndarray:
    """A viewer before the avatar, looking at it: their left is the avatar's right."""
    pose = np.diag([-1.0, 1.0, -1.0, 1.0])
    pose[2, 3] = distance_mm
    return pose


def test_the_eyes_of_a_head_lie_beside_its_middle():
    views = eye_viewmats(facing_pose(600.0), eye_distance_mm=64.0)
    places = [-view[:3, :3].T @ view[:3, 3] for view in views]
    # The viewer's left eye is at the avatar's right (-x), at the same height and distance.
    assert places[0] == pytest.approx((-32.0, 0.0, 600.0))
    assert places[1] == pytest.approx((32.0, 0.0, 600.0))
    for view in views:
        assert view[:3, :3] @ view[:3, :3].T == pytest.approx(np.eye(3), abs=1e-12)
        assert np.linalg.det(view[:3, :3]) == pytest.approx(1.0)
        assert (view @ (0.0, 0.0, 0.0, 1.0))[2] == pytest.approx(600.0)  # before the camera
        assert (view @ (0.0, 50.0, 0.0, 1.0))[1] < 0.0  # up is up


def test_off_axis_edges_lie_at_the_given_tangents():
    camera = off_axis(np.eye(4), (1.2, 0.8, 0.9, 1.1), 200, 100)
    assert pixel(camera, (-1.2, 0.0, 1.0))[0] == pytest.approx(0.0)
    assert pixel(camera, (0.8, 0.0, 1.0))[0] == pytest.approx(200.0)
    assert pixel(camera, (0.0, -0.9, 1.0))[1] == pytest.approx(0.0)
    assert pixel(camera, (0.0, 1.1, 1.0))[1] == pytest.approx(100.0)


def test_the_screen_has_no_parallax_and_near_things_come_out_of_it():
    camera = portrait(400, 300, yaw_deg=20.0, distance_mm=700.0)
    left, right = side_by_side(camera, 64.0, screen_mm=700.0)
    inverse = np.linalg.inv(camera.viewmat)

    def place(depth_mm: float) -> np.ndarray:
        return (inverse @ (30.0, -20.0, depth_mm, 1.0))[:3]

    assert pixel(left, place(700.0)) == pytest.approx(pixel(camera, place(700.0)))
    assert pixel(right, place(700.0)) == pytest.approx(pixel(camera, place(700.0)))
    assert pixel(left, place(600.0))[0] > pixel(right, place(600.0))[0]  # crossed: nearer
    assert pixel(left, place(900.0))[0] < pixel(right, place(900.0))[0]
    shift = pixel(left, place(600.0)) - pixel(right, place(600.0))
    assert shift[0] == pytest.approx(camera.K[0, 0] * 64.0 * (1 / 600 - 1 / 700))
    assert shift[1] == pytest.approx(0.0)


def test_both_ways_agree_for_a_viewer_before_the_head():
    """side_by_side is off_axis with a window cut out of the screen."""
    camera = portrait(320, 320, distance_mm=700.0, target_mm=(0.0, 0.0, 0.0))
    pair = side_by_side(camera, 64.0)
    half = 160.0 / camera.K[0, 0]
    views = eye_viewmats(facing_pose(700.0), 64.0)
    for eye, moved in enumerate((32.0 / 700.0, -32.0 / 700.0)):
        tangents = (half - moved, half + moved, half, half)
        lens = off_axis(views[eye], tangents, 320, 320)
        assert pytest.approx(pair[eye].K) == lens.K
        assert lens.viewmat == pytest.approx(pair[eye].viewmat)


def test_a_pair_is_both_eyes_pictures(tiles):
    head = take(head_scene(3000), slice(0, None, 2))
    pair = side_by_side(portrait(96, 128, yaw_deg=-15.0))
    picture = draw_pair(tiles, head, pair)
    assert picture.shape == (128, 192, 4)
    reference = ReferenceRenderer()
    for eye, camera in enumerate(pair):
        reference.draw(head, camera)
        half = picture[:, 96 * eye : 96 * (eye + 1), :3]
        assert psnr_db(half, reference.read_rgba()[..., :3]) > 55.0
    assert psnr_db(picture[:, :96], picture[:, 96:]) < 40.0  # they differ


def test_what_makes_no_sense_is_an_input_error(tiles):
    camera = portrait(64, 64)
    with pytest.raises(InputError, match="eye distance"):
        eye_viewmats(np.eye(4), -1.0)
    with pytest.raises(InputError, match="field of view"):
        off_axis(np.eye(4), (0.5, -0.5, 1.0, 1.0), 64, 64)
    with pytest.raises(InputError, match="screen"):
        side_by_side(camera, screen_mm=0.0)
    with pytest.raises(InputError, match="one height"):
        draw_pair(tiles, head_scene(10), (camera, portrait(64, 32)))
