"""Axes and angles of other programs: signs and handedness on all six of them."""

from math import radians

import numpy as np
import pytest

from sensors import rotation
from sensors.types import HeadPose

RNG = np.random.default_rng(0)
TURNS = [tuple(v / np.linalg.norm(v)) for v in RNG.standard_normal((50, 4))]
FORWARD, LEFT, UP = (0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)


def about(axis: int, degrees: float) -> rotation.Quat:
    angles = [0.0, 0.0, 0.0]
    angles[axis] = radians(degrees)
    return rotation.from_angles((angles[0], angles[1], angles[2]))


def test_positive_turns_nod_down_look_left_and_tilt_right() -> None:
    assert rotation.rotate(about(0, 30), FORWARD)[1] == pytest.approx(-0.5)
    assert rotation.rotate(about(1, 30), FORWARD)[0] == pytest.approx(0.5)  # the subject's left
    assert rotation.rotate(about(2, 30), LEFT)[1] == pytest.approx(0.5)  # the left ear goes up


def test_a_headset_that_moves_right_up_and_back_and_turns_left() -> None:
    half = radians(15)
    left = (0.0, np.sin(half), 0.0, np.cos(half))  # WebXR: about +y, seen from above to the left
    pose = rotation.from_xr((0.01, 0.02, 0.03), left)
    assert pose.position == pytest.approx((-10, 20, -30))
    assert rotation.rotate(pose.quat, FORWARD)[0] == pytest.approx(0.5)
    up = (np.sin(half), 0.0, 0.0, np.cos(half))  # about +x: looks up
    assert rotation.rotate(rotation.from_xr((0, 0, 0), up).quat, FORWARD)[1] == pytest.approx(0.5)
    tilt = (0.0, 0.0, np.sin(half), np.cos(half))  # about +z, backwards: the right ear goes up
    turned = rotation.rotate(rotation.from_xr((0, 0, 0), tilt).quat, LEFT)
    assert turned[1] == pytest.approx(-0.5)


def test_unity_turns_the_other_way() -> None:
    half = radians(15)
    right = (0.0, np.sin(half), 0.0, np.cos(half))  # left-handed: about +y is to the right
    pose = rotation.from_unity((0.01, 0.02, 0.03), right)
    assert pose.position == pytest.approx((-10, 20, 30))
    assert rotation.rotate(pose.quat, FORWARD)[0] == pytest.approx(-0.5)
    down = (np.sin(half), 0.0, 0.0, np.cos(half))
    turned = rotation.rotate(rotation.from_unity((0, 0, 0), down).quat, FORWARD)
    assert turned[1] == pytest.approx(-0.5)


@pytest.mark.parametrize("quat", TURNS)
def test_there_and_back(quat: rotation.Quat) -> None:
    pose = rotation.checked((1.0, -2.0, 3.0), quat)
    position, xyzw = rotation.to_unity(pose)
    assert rotation.from_unity(position, xyzw).position == pytest.approx(pose.position)
    assert rotation.angle_between(rotation.from_unity(position, xyzw).quat, pose.quat) < 1e-6
    again = rotation.from_angles(rotation.to_angles(pose.quat))
    assert rotation.angle_between(again, pose.quat) < 1e-6


def test_slerp_goes_the_short_way_at_an_even_pace() -> None:
    start, end = about(1, 0), tuple(-x for x in about(1, 40))
    halfway = rotation.slerp(start, end, 0.5)  # type: ignore[arg-type]
    assert rotation.angle_between(halfway, about(1, 20)) < 1e-7
    assert rotation.slerp(start, start, 0.3) == pytest.approx(start)


@pytest.mark.parametrize(
    ("position", "quat"),
    [
        ((0, 0, 0), (0, 0, 0, 0)),
        ((0, 0, float("nan")), (1, 0, 0, 0)),
        ((0, float("inf"), 0), (1, 0, 0, 0)),
        ((0, 0, 0), (float("nan"), 0, 0, 1)),
        ((0, 0, 0), (3, 0, 0, 0)),
        ((0, 0, 1e9), (1, 0, 0, 0)),
        ((0, 0), (1, 0, 0, 0)),
    ],
)
def test_what_is_no_pose_is_refused(position, quat) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(ValueError):
        rotation.checked(position, quat)


def test_a_unit_quaternion_stays_as_it_is_to_the_bit() -> None:
    pose = rotation.checked((0, 0, 0), (0.9, 0.3, 0.2, 0.1))
    assert rotation.checked(pose.position, pose.quat) == HeadPose(pose.position, pose.quat)
