"""Where the head stands before the wearer, and how finely it is drawn."""

from math import radians

import numpy as np
import pytest

from app.xr.budget import LEVELS, PATIENCE, Budget
from app.xr.place import AHEAD_MM, eye_camera, in_front
from app.xr.runtimes.protocol import XYZW, Eye
from app.xr.runtimes.standin import HALF_EYES_M, TANGENTS, eyes_of
from render.splats.stereo import eye_viewmats, off_axis

BETWEEN_EYES = np.array([0.0, 28.0, 60.0])
GREY = (0.16, 0.16, 0.16)


def turned(yaw_deg: float) -> XYZW:
    return (0.0, float(np.sin(radians(yaw_deg) / 2)), 0.0, float(np.cos(radians(yaw_deg) / 2)))


def seen(eye: Eye, place: np.ndarray, point: np.ndarray) -> tuple[np.ndarray, float]:
    """Slopes to the right and down, and the distance along the view."""
    x, y, z, _ = eye_camera(eye, place, 100, 100, GREY).viewmat @ (*point, 1.0)
    assert z > 0
    return np.array([x / z, y / z]), z


@pytest.mark.parametrize("yaw_deg", [0.0, 70.0, -160.0])
def test_the_head_looks_the_wearer_in_the_eye(yaw_deg: float) -> None:
    eyes = eyes_of((0.4, 1.7, -0.2), turned(yaw_deg))
    place = in_front(eyes, BETWEEN_EYES)
    for eye, side in zip(eyes, (1, -1), strict=True):
        at, distance = seen(eye, place, BETWEEN_EYES)
        assert distance == pytest.approx(AHEAD_MM)
        assert at == pytest.approx((side * 1e3 * HALF_EYES_M / AHEAD_MM, 0))
        # The head faces the wearer: what is on its left, they see on the right.
        assert seen(eye, place, BETWEEN_EYES + (30, 0, 0))[0][0] > at[0]
        up, nearer = seen(eye, place, BETWEEN_EYES + (0, 40, 10))
        assert up[1] < 0 and nearer == pytest.approx(AHEAD_MM - 10)


def test_both_eyes_are_those_of_a_viewer_before_the_head() -> None:
    eyes = eyes_of((0.0, 1.6, 0.0), turned(0.0))
    place = in_front(eyes, BETWEEN_EYES)
    viewer = np.diag([-1.0, 1.0, -1.0, 1.0])
    viewer[:3, 3] = BETWEEN_EYES + (0, 0, AHEAD_MM)
    views = eye_viewmats(viewer, 2e3 * HALF_EYES_M)
    for eye, view, tangents in zip(eyes, views, TANGENTS, strict=True):
        camera, wanted = eye_camera(eye, place, 80, 60, GREY), off_axis(view, tangents, 80, 60)
        np.testing.assert_allclose(camera.viewmat, view, atol=1e-9)
        np.testing.assert_allclose(camera.K, wanted.K)


def test_a_wearer_who_tilts_the_head_gets_an_upright_one() -> None:
    tilted = (0.2, 0.0, 0.2, float(np.sqrt(0.92)))
    eyes = tuple(Eye((x, 1.5, 0.0), tilted, TANGENTS[0]) for x in (-0.03, 0.03))
    place = in_front((eyes[0], eyes[1]), BETWEEN_EYES)
    np.testing.assert_allclose(place[:3, 1], (0, 1, 0), atol=1e-12)
    np.testing.assert_allclose(place[:3, :3] @ place[:3, :3].T, np.eye(3), atol=1e-12)


def test_pictures_get_coarser_where_time_is_short_and_finer_again() -> None:
    budget = Budget()
    for _ in range(PATIENCE * 20):
        budget.spent(12, 10)
    assert budget.share == LEVELS[-1]
    for cost in [3, *[7] * PATIENCE]:
        budget.spent(cost, 10)
    assert budget.share == LEVELS[-1]
    for _ in range(PATIENCE * 20):
        budget.spent(3, 10)
    assert budget.share == 1.0
    for _ in range(PATIENCE * 2):
        budget.spent(50, 0)
    assert budget.share == 1.0
