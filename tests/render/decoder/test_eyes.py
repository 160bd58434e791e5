"""What an eye shows: the shade of its lid, a highlight that stays on it, lids that go with it."""

import numpy as np
import pytest
from scenes import rig_of

from render.avatars.sheet import gaze
from render.decoder import identity, posing
from render.decoder.eyes import OPACITY as HIGHLIGHT_OPACITY
from render.decoder.learned import avatar_files
from render.decoder.posing import followed
from render.types import AHEAD


def test_a_lid_shades_the_eye_below_it(decoder):
    who = identity.load("ben")
    line, eye = decoder.posing.lid_lines[0], decoder.eyes[0].ball
    vertices = decoder.posing.pose(rig_of(decoder), AHEAD, who.rest)
    means = decoder.decode(np.zeros(256, np.float32), AHEAD, who)[1].means
    points, white = means[eye], np.ones((int(eye.max()) + 1, 3), np.float32)
    line.tint_covered(vertices, means, eye, np.ones(3, np.float32), white)
    clear = np.array([line.clearance(vertices, p) for p in points])
    middle = points[:, 1] > np.median(points[clear > 0, 1])  # nearer to the upper lid
    near, far = (white[eye[middle & (clear > a) & (clear < b)]] for a, b in ((0, 1), (3, 9)))
    assert near.mean() < 0.85 < 0.93 < far.mean()


@pytest.mark.parametrize("name", avatar_files.names())
def test_the_highlight_lies_on_the_eye_and_not_in_it(decoder, name):
    """Eyes differ in size: a spot at one distance hid inside the larger half of them."""
    who = identity.load(name)
    for direction in (AHEAD, gaze(20, 0), gaze(-15, -8)):
        _, cloud = decoder.decode(np.zeros(256, np.float32), direction, who)
        for eye, rows in enumerate(of.ball for of in decoder.eyes):
            spot, ball = cloud.means[len(decoder.opacities) + eye], cloud.means[rows]
            around = np.hypot(*(ball - spot)[:, :2].T) < 1.5
            assert 0 < spot[2] - ball[around, 2].max() < 1.5


def test_the_highlight_stays_on_the_cornea(decoder):
    who = identity.load("ada")
    for direction in (AHEAD, gaze(25, 0), gaze(-10, 15)):
        _, cloud = decoder.decode(np.zeros(256, np.float32), direction, who)
        spots = cloud.means[len(decoder.opacities) : len(decoder.opacities) + 2]
        distance = np.linalg.norm(spots - who.eye_centers, axis=1)
        assert (abs(distance - 16.5) < 1.6).all()
    for direction in (gaze(-25, -15), gaze(25, 15)):  # red before: on the white, beside the iris
        _, cloud = decoder.decode(np.zeros(256, np.float32), direction, who)
        spots = cloud.means[len(decoder.opacities) : len(decoder.opacities) + 2]
        for eye, arm in enumerate(spots - who.eye_centers):
            off = posing.eye_rotation(direction[eye], eye)[:, 2] @ arm / np.linalg.norm(arm)
            assert np.degrees(np.arccos(off)) < 21.6  # half the angle of an iris
    assert posing.gaze_rotation(AHEAD[0]).shape == (3, 3)


def test_lids_go_with_the_eyes(decoder):
    looks, still = decoder.posing.looks, np.zeros(len(decoder.posing.full_blink()), np.float32)
    up, down = (followed(still, gaze(20, pitch), looks)[looks] for pitch in (15, -15))
    assert (up[:, 0] > 0.3).all() and (down[:, 1] > 0.3).all()
    assert (up[:, 1] == 0).all() and (down[:, 0] == 0).all()
    given = rig_of(decoder, eyeLookDown_L=0.8, eyeLookDown_R=0.8)
    assert (followed(given, gaze(0, -10), looks)[looks][:, 1] == np.float32(0.8)).all()
    np.testing.assert_array_equal(followed(given, AHEAD, looks), given)


@pytest.mark.slow
@pytest.mark.parametrize("name", avatar_files.names())
def test_a_lid_covers_the_highlight(decoder, name):
    """It lies before the cornea, and so before the lid that slides over it."""
    who = identity.load(name)
    shares = []
    for blink in np.linspace(0, 1, 21):
        rig = rig_of(decoder, eyeBlink_L=blink, eyeBlink_R=blink)
        _, cloud = decoder.decode(decoder.encode(rig), AHEAD, who)
        shares.append(
            cloud.opacities[len(decoder.opacities) : len(decoder.opacities) + 2] / HIGHLIGHT_OPACITY
        )
    shares = np.array(shares)
    assert shares[0].min() > 0.5 and shares[12:].max() == 0
    assert (np.diff(shares, axis=0) <= 0).all()


def test_the_highlight_fades_where_the_edge_of_the_lid_is(decoder):
    who = identity.load("kofi")
    for looking, blink in ((AHEAD, 0.28), (gaze(20, 0), 0.28), (gaze(0, -12), 0.5)):
        rig = rig_of(decoder, eyeBlink_L=blink, eyeBlink_R=blink)
        mesh, cloud = decoder.decode(decoder.encode(rig), looking, who)
        for eye, line in enumerate(decoder.posing.lid_lines):
            spot = cloud.means[len(decoder.opacities) + eye]
            edge = mesh.vertices[line.upper]
            near = edge[np.argsort(np.abs(edge[:, 0] - spot[0]))[:4], 1].mean()
            bare = near - spot[1]
            share = cloud.opacities[len(decoder.opacities) + eye] / HIGHLIGHT_OPACITY
            assert share == pytest.approx(np.clip((bare + 0.3) / 0.9, 0, 1), abs=0.4)
