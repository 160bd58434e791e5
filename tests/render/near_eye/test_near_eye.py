"""The near-eye cameras: what is drawn is what the truth says."""

from dataclasses import replace

import numpy as np
import pytest

from render.decoder import identity
from render.decoder.decoder import Decoder
from render.decoder.learned import avatar_files
from render.near_eye.camera import NearEye, Wearer
from render.near_eye.look import Look, varied


def straight_look() -> Look:
    """A camera a little below, a clean sensor, a dark pupil in a bright iris."""
    look = Look.draw(np.random.default_rng(4))
    return replace(
        look, outward_deg=4.0, below_deg=18.0, distance=48.0, target=(0.0, 0.0, 13.0),
        view_deg=50.0, roll_deg=0.0, pupil=2.6, iris_tone=0.7, pupil_tone=0.0, sclera_tone=0.9,
        noise=0.5, blur_px=0.8, reflections=0, motion_px=0.0, gloss=0.05, brow_hairs=0, lashes=4,
        exposure=120.0, vignette=0.0, albedo=0.6,
    )  # fmt: skip


@pytest.fixture(scope="module")
def near_eye(decoder: Decoder):
    renderer = NearEye(decoder)
    yield renderer
    renderer.close()


@pytest.fixture(scope="module")
def wearer(near_eye: NearEye) -> Wearer:
    return near_eye.wear(identity.load("ben"), straight_look(), np.random.default_rng(0))


def gaze(yaw: float, pitch: float) -> np.ndarray:
    y, p = np.radians([yaw, pitch])
    one = np.array([np.sin(y) * np.cos(p), np.sin(p), np.cos(y) * np.cos(p)], np.float32)
    return np.stack([one, one])


def rig_of(near_eye: NearEye, **values: float) -> np.ndarray:
    rig = np.zeros(len(near_eye.decoder.rig_names), np.float32)
    for name, value in values.items():
        rig[near_eye.decoder.rig_names.index(name)] = value
    return rig


def dark_center(picture: np.ndarray) -> np.ndarray:
    """[2] x, y of the darkest spot near the middle."""
    middle = picture[100:300, 100:300].astype(float)
    y, x = np.nonzero(middle < middle.min() + 18)
    return np.array([x.mean(), y.mean()])


def test_pupils_follow_the_gaze(near_eye, wearer):
    rig, rng = rig_of(near_eye), np.random.default_rng(1)
    places = {
        at: [dark_center(p) for p in near_eye.draw(wearer, rig, gaze(*at), rng).pictures]
        for at in ((0, 0), (14, 0), (0, -9))
    }
    for eye in range(2):  # the subject's left is the picture's right
        side = places[14, 0][eye] - places[0, 0][eye]
        down = places[0, -9][eye] - places[0, 0][eye]
        assert side[0] > 10 and abs(side[1]) < 0.5 * side[0]
        assert down[1] > 6 and abs(down[0]) < 0.5 * down[1]


def test_lids_close_and_hide_the_pupil(near_eye, wearer):
    rng = np.random.default_rng(2)
    pairs = [
        near_eye.draw(
            wearer, rig_of(near_eye, eyeBlink_L=shut, eyeBlink_R=shut), gaze(0, 0), rng
        )
        for shut in (0.0, 0.5, 1.0)
    ]  # fmt: skip
    lids = np.array([pair.lids for pair in pairs])
    assert np.all(np.diff(lids, axis=0) < -0.2)
    assert lids[0] == pytest.approx(1, abs=0.02) and np.all(lids[2] < 0.12)
    darkest = [np.sort(pair.pictures[:, 120:280, 120:280].ravel())[2000] for pair in pairs]
    assert darkest[0] < 30 and darkest[2] > 45


def test_one_lid_closes_alone(near_eye, wearer):
    lids = near_eye.draw(
        wearer, rig_of(near_eye, eyeBlink_R=1.0), gaze(0, 0), np.random.default_rng(3)
    ).lids
    assert lids[0] > 0.9 and lids[1] < 0.15


def test_lamps_are_mirrored_in_the_cornea(near_eye, wearer):
    dark = replace(wearer.look, leds=tuple((x, y, z) for x, y, z in wearer.look.leds[:4]))
    picture = near_eye.draw(
        wearer, rig_of(near_eye), gaze(0, 0), np.random.default_rng(4), dark
    ).pictures[0]
    center = dark_center(picture) + 100
    x, y = center.astype(int)
    near = picture[y - 70 : y + 70, x - 70 : x + 70]
    assert (near == 255).sum() > 10
    assert picture.std() > 15


def test_the_same_seed_draws_the_same_pictures(near_eye, wearer):
    pairs = [
        near_eye.draw(wearer, rig_of(near_eye), gaze(3, 2), np.random.default_rng(5)).pictures
        for _ in range(2)
    ]
    np.testing.assert_array_equal(*pairs)


def test_people_vary_but_keep_their_eyeballs_in_place():
    people = [identity.load(name) for name in avatar_files.names()]
    one, other = (varied(people, np.random.default_rng(k)) for k in (1, 2))
    assert np.abs(one.geometry - other.geometry).max() > 0.5
    assert np.linalg.norm(one.eye_centers - people[0].eye_centers, axis=1).max() < 8
