"""Contact of lips and lids, on faces and expressions the rig was not made for."""

import numpy as np
import pytest
from scipy.spatial import KDTree

from render.avatars import sheet
from render.avatars.sheet import gaze
from render.decoder import identity, posing
from render.decoder.decoder import Decoder
from render.decoder.eyes import OPACITY as HIGHLIGHT_OPACITY
from render.decoder.posing import OVERSHOOT, SOFT_LIMIT, TOUCH_MM, followed, limit
from render.evaluation.metrics import LipCrossing
from render.types import AHEAD

COLUMNS = 55  # 53 shapes of the rig and 2 of the tongue


def rig_of(decoder: Decoder, **activations: float) -> np.ndarray:
    rig = np.zeros(COLUMNS, np.float32)
    for name, value in activations.items():
        rig[decoder.rig_names.index(name)] = value
    return rig


def strange_face(seed: int) -> np.ndarray:
    """Ben, bent: lips apart or crossed by millimetres, eyes wider open."""
    rng = np.random.default_rng(seed)
    rest = identity.load("ben").geometry.copy()
    waves = np.sin(rest / rng.uniform(20, 40, 3) + rng.uniform(0, 6, 3))
    return rest + waves @ rng.normal(0, 0.9, (3, 3)).astype(np.float32)


@pytest.mark.parametrize("seed", range(4))
def test_lips_of_any_face_are_sealed_at_rest(decoder, seed):
    rest = decoder.posing.rest(strange_face(seed).astype(np.float32))
    gaps = decoder.posing.mouth.gaps(rest.geometry)
    assert np.abs(gaps - TOUCH_MM).max() < 0.15


@pytest.mark.parametrize("seed", range(4))
def test_lids_of_any_face_shut(decoder, seed):
    rest = decoder.posing.rest(strange_face(seed).astype(np.float32))
    shut = decoder.posing.pose(rig_of(decoder, eyeBlink_L=1, eyeBlink_R=1), AHEAD, rest)
    open_ = decoder.posing.pose(rig_of(decoder), AHEAD, rest)
    for line in decoder.posing.lid_lines:
        assert line.gaps(shut).max() < 0.5 and line.gaps(shut).min() > -0.3
        assert line.gaps(open_).max() > 4


def test_lips_never_cross(decoder):
    rest = identity.load("ada").rest
    rng = np.random.default_rng(0)
    for _ in range(30):
        rig = np.zeros(COLUMNS, np.float32)
        rig[rng.choice(53, 8)] = rng.uniform(0.3, 1, 8)
        posed = decoder.posing.pose(rig, AHEAD, rest)
        assert decoder.posing.mouth.gaps(posed).min() > -0.3


PRESSED = (
    {"mouthRollUpper": 0.9, "mouthShrugLower": 0.9},
    {"mouthPucker": 0.9, "mouthFunnel": 0.8},
    {"mouthPress_L": 0.9, "mouthPress_R": 0.9, "mouthRollUpper": 0.6},
)


@pytest.mark.parametrize("activations", PRESSED)
def test_lips_that_press_do_not_cross_away_from_their_line(decoder, activations):
    """By the measure of the evaluation, which pairs the vertices of each person anew."""
    upper, lower = decoder.regions["lips_upper"], decoder.regions["lips_lower"]
    for seed in range(4):
        rest = decoder.posing.rest(strange_face(seed).astype(np.float32))
        posed = decoder.posing.pose(rig_of(decoder, **activations), AHEAD, rest)
        assert LipCrossing(rest.geometry, upper, lower).depth_mm(posed) < 0.3


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


def test_closing_the_mouth_only_undoes_the_jaw(decoder):
    """mouthClose without jawOpen would drive the lips through each other."""
    rest = identity.load("ben").rest
    posed = decoder.posing.pose(rig_of(decoder, mouthClose=1.0), AHEAD, rest)
    assert np.abs(posed - rest.geometry).max() < 3.0


def test_lids_stay_outside_the_eyeball(decoder):
    rest = identity.load("kofi").rest
    for blink in (0.25, 0.5, 0.75, 1.0):
        rig = rig_of(decoder, eyeBlink_L=blink, eyeBlink_R=blink)
        posed = decoder.posing.pose(rig, AHEAD, rest)
        for eye, lids in enumerate(decoder.posing.lids):
            distance = np.linalg.norm(posed[lids] - rest.eye_centers[eye], axis=1)
            assert (distance - rest.reach[eye]).min() > -0.8


def test_limit_keeps_what_is_plausible_and_draws_in_the_rest():
    rig = np.float32([-3, -0.05, 0, 0.4, 1, 1.05, 9])
    out = limit(rig)
    np.testing.assert_array_equal(out[1:6], rig[1:6])
    assert SOFT_LIMIT[0] - OVERSHOOT <= out[0] < -0.1 and 1.1 < out[6] <= SOFT_LIMIT[1] + OVERSHOOT


def test_any_sample_of_the_prior_is_a_face(decoder):
    """Codes from a Gaussian: nothing explodes, most of the face moves by millimetres."""
    who = identity.load("ben")
    for seed in range(20):
        code = decoder.sample(np.random.default_rng(seed))
        moved = np.linalg.norm(decoder.vertices(code, AHEAD, who) - who.geometry, axis=1)
        assert moved.max() < 45 and np.median(moved) < 6


@pytest.mark.parametrize("name", identity.names())
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
@pytest.mark.parametrize("name", identity.names())
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


def test_the_inside_of_a_closed_mouth_is_not_drawn(decoder):
    who = identity.load("ben")
    shut = decoder.decode(np.zeros(256, np.float32), AHEAD, who)[1]
    opened = decoder.decode(decoder.encode(rig_of(decoder, jawOpen=0.7)), AHEAD, who)[1]
    assert shut.opacities[decoder.interior].max() == 0
    assert opened.opacities[decoder.interior].mean() > 0.3


def test_light_follows_the_expression(decoder):
    """An open mouth lets light in: the learned part of the decoder."""
    who = identity.load("ben")
    tongue = np.isin(decoder.surface.used, np.arange(14062, 17039))
    still = decoder.visibility(np.zeros(256, np.float32), who)
    np.testing.assert_allclose(still, who.visibility, atol=1e-6)
    opened = decoder.visibility(decoder.encode(rig_of(decoder, jawOpen=0.8)), who)
    assert opened[0, tongue].mean() > still[0, tongue].mean() + 0.008


@pytest.mark.parametrize("name", identity.names())
def test_no_gum_comes_through_a_smiling_lip(decoder, name):
    who = identity.load(name)
    _, cloud = decoder.decode(sheet.code(decoder, sheet.MOODS["happy"][0]), AHEAD, who)
    means = cloud.means[: len(decoder.opacities)]
    skin = np.setdiff1d(np.arange(len(means)), decoder.interior)
    skin = skin[(means[skin, 2] > 80) & (np.abs(means[skin, 0]) < 30)]
    upper = means[decoder.interior]
    upper = upper[(np.abs(upper[:, 0]) < 15) & (upper[:, 2] > 80)]
    apart, near = KDTree(means[skin, :2]).query(upper[:, :2], k=4)
    before = means[skin][near, 2].max(1)
    assert (upper[:, 2] - before)[apart.max(1) < 2].max() < 0.7  # at the edge of the lip


@pytest.mark.parametrize("name", ["hugo", "joao", "kofi"])
def test_no_beard_grows_behind_the_lips(decoder, name):
    who = identity.load(name)
    rig = rig_of(decoder, mouthFunnel=1.0, jawOpen=0.3)
    posed = decoder.posing.pose(rig, AHEAD, who.rest)
    means, quats = (np.empty((len(who.beard), n), np.float32) for n in (3, 4))
    who.beard.attach(posed, means, quats)
    opening = decoder.posing.mouth.between_sides(posed, means)
    behind = means[:, 2] < posed[decoder.posing.mouth.upper, 2].mean()
    assert not (opening & behind).any()


@pytest.mark.parametrize("name", identity.names())
def test_a_shirt_has_a_hem_all_around(decoder, name):
    who = identity.load(name)
    roots = (who.geometry[who.beard.corners] * who.beard.shares[..., None]).sum(1)
    hem = roots[roots[:, 1] < -95]
    turn = np.sort(np.arctan2(hem[:, 0], hem[:, 2] - hem[:, 2].mean()))
    assert np.degrees(np.diff(turn).max()) < 14


def test_a_tongue_at_the_teeth_is_lit(decoder):
    """And the nearer it is to them, the more; what sees more is left as it is."""
    who, light = identity.load("ben"), decoder.tongue_light
    names = np.zeros(COLUMNS, np.float32)
    names[decoder.rig_names.index("jawOpen")] = 0.15
    raised = names.copy()
    raised[53] = 1  # its tip
    tips, lit = [], []
    for rig in (names, raised):
        posed = decoder.posing.pose(rig, AHEAD, who.rest)
        seen = np.full((4, len(decoder.surface.used)), 0.05, np.float32)
        light.fill(posed, who.geometry, seen, decoder.posing.mouth.gaps(posed).max())
        tips.append(posed[light.vertices, 2].max())
        lit.append(seen[:2, light.rows].max())
        assert (seen[2:] == np.float32(0.05)).all()
    upper = who.geometry[decoder.posing.mouth.upper, 2].max()
    assert tips[0] + 6 < tips[1] < upper and lit[0] < 0.4 < 0.7 < lit[1] < 1
    seen = np.ones((4, len(decoder.surface.used)), np.float32)
    light.fill(who.geometry, who.geometry, seen, 9.0)
    assert (seen[:, light.rows] == 1).all()
    seen *= 0
    light.fill(who.geometry, who.geometry, seen, 2.0)
    assert (seen == 0).all()  # behind teeth that shut
