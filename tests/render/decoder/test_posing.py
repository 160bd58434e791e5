"""Contact of lips and lids, on faces and expressions the rig was not made for."""

import numpy as np
import pytest
from scenes import COLUMNS, rig_of
from scipy.spatial import KDTree

from render.avatars import sheet
from render.decoder import identity
from render.decoder.learned import avatar_files
from render.decoder.posing import OVERSHOOT, SOFT_LIMIT, TOUCH_MM, limit
from render.evaluation.metrics import LipCrossing
from render.types import AHEAD


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


@pytest.mark.parametrize("name", avatar_files.names())
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


@pytest.mark.parametrize("name", avatar_files.names())
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
