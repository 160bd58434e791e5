"""The neck: what turns with the head, what stays, and that nothing tears."""

from math import degrees, radians

import numpy as np
import pytest

from render.decoder import identity
from render.decoder.decoder import Decoder
from render.decoder.neck import LIMIT_MM, LIMITS_RAD, limited
from render.lighting import STUDIO, developed
from render.types import AHEAD, FIELDS, Gaussians
from sensors import rotation
from sensors.types import HeadPose

STILL = np.zeros(256, np.float32)
TURNS = {"yaw": (0, 30, 0), "pitch": (20, 0, 0), "up": (-20, 0, 0), "roll": (0, 0, 15)}


def turned(pitch: float, yaw: float, roll: float, position=(0.0, 0.0, 0.0)) -> HeadPose:  # type: ignore[no-untyped-def]
    return HeadPose(position, rotation.from_angles((radians(pitch), radians(yaw), radians(roll))))


def skin(decoder: Decoder, name: str, head: HeadPose, **more: float) -> Gaussians:
    return decoder.decode(STILL, AHEAD, identity.load(name), head, **more)[1]


def along(decoder: Decoder, name: str) -> np.ndarray:  # [N] of the skin's Gaussians
    who = identity.load(name)
    cache = decoder.cached(who)
    share = decoder.surface.interpolate @ cache.neck.along(who.geometry[decoder.surface.used])
    return share


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ada", "hugo", "lena"])
@pytest.mark.parametrize("turn", TURNS.values(), ids=TURNS)
def test_the_head_is_rigid_and_the_shoulders_stay(decoder, name, turn) -> None:  # type: ignore[no-untyped-def]
    head, share = turned(*turn), along(decoder, name)
    rest, now = skin(decoder, name, HeadPose()), skin(decoder, name, head)
    count = len(share)
    on_head, on_chest = np.flatnonzero(share > 0.99995), np.flatnonzero(share < 1e-6)
    assert len(on_head) > 0.5 * count and len(on_chest) > 50
    np.testing.assert_allclose(now.means[on_chest], rest.means[on_chest], atol=0.05)
    a, b = (cloud.means[on_head].astype(np.float64) for cloud in (rest, now))
    u, _, v = np.linalg.svd((a - a.mean(0)).T @ (b - b.mean(0)))
    matrix = (u @ v).T
    np.testing.assert_allclose(b - b.mean(0), (a - a.mean(0)) @ matrix.T, atol=0.02)
    wanted = np.stack([rotation.rotate(head.quat, e) for e in np.eye(3).tolist()], 1)
    np.testing.assert_allclose(matrix, wanted, atol=1e-3)


@pytest.mark.parametrize("turn", TURNS.values(), ids=TURNS)
def test_neighbours_on_the_neck_stay_neighbours(decoder, turn) -> None:  # type: ignore[no-untyped-def]
    rest, now = skin(decoder, "ben", HeadPose()), skin(decoder, "ben", turned(*turn))
    share = along(decoder, "ben")
    between = np.flatnonzero((share > 0.001) & (share < 0.999))
    means = rest.means[between]
    for k in range(0, len(between), 40):
        distance = np.linalg.norm(means - means[k], axis=1)
        near = np.flatnonzero((distance > 0.5) & (distance < 6))
        moved = np.linalg.norm(now.means[between[near]] - now.means[between[k]], axis=1)
        assert (moved < 2.2 * distance[near]).all()
        assert (moved > 0.2 * distance[near]).all()


def test_hair_and_beard_follow(decoder: Decoder) -> None:
    head = turned(0, 30, 0)
    who = identity.load("hugo")
    roots = who.geometry[who.beard.corners[:, 0], 1]
    assert (roots > -90).sum() > 5000 and roots.min() < -100  # beard, and the hem of the shirt
    rest, now = (
        skin(decoder, "hugo", pose).means[-len(who.beard) :] for pose in (HeadPose(), head)
    )
    moved = np.linalg.norm(now - rest, axis=1)
    assert moved[roots > -90].min() > 1
    who = identity.load("lena")
    rest, now = skin(decoder, "lena", HeadPose()), skin(decoder, "lena", head)
    last = len(rest) - len(who.beard)
    hair = who.hair.of_density(decoder.density)
    low = slice(last - len(hair), last)
    moved = np.linalg.norm(now.means[low] - rest.means[low], axis=1)
    heights = hair.means[:, 1]
    assert moved[heights > 100].mean() > 15 and moved[heights < -250].max() < 0.1
    assert not np.allclose(now.quats[low], rest.quats[low])


def test_light_changes_as_the_head_turns(decoder: Decoder) -> None:
    left, right = (skin(decoder, "ben", turned(0, yaw, 0)) for yaw in (30, -30))
    share = along(decoder, "ben")
    face = share > 0.999
    difference = np.abs(left.colors[: len(share)][face] - right.colors[: len(share)][face])
    assert difference.mean() > 0.02
    chest = share < 1e-6
    np.testing.assert_allclose(
        left.colors[: len(share)][chest], right.colors[: len(share)][chest], atol=2e-3
    )
    assert STUDIO.key


def test_light_falls_on_turned_skin_teeth_and_scalp(decoder: Decoder) -> None:
    who, head = identity.load("ben"), turned(0, 30, 0)
    cloud, surface = skin(decoder, "ben", head), decoder.surface
    matrix = np.stack([rotation.rotate(head.quat, e) for e in np.eye(3).tolist()], 1)
    normals = surface.whole.normals(who.geometry)[0] @ matrix.T.astype(np.float32)
    seen = decoder.visibility(STILL, who)
    decoder.teeth_light.fill(seen, 0.0)
    decoder.tongue_light.fill(who.geometry, who.geometry, seen, 0.0)
    light = surface.interpolate @ STUDIO.shade(normals, seen.T)
    expected = developed((decoder.shares @ who.albedo) ** 2 * light)
    moving = np.zeros(len(surface.used), np.float32)
    moving[surface.live] = (
        1  # live skin is not quite at rest in a face at rest: its lips are parted
    )
    still = (along(decoder, "ben") > 0.99999) & (surface.interpolate @ moving == 0)
    still[np.concatenate([eye.covered for eye in decoder.eyes])] = False  # lids colour these
    assert still[decoder.interior].sum() > 1000 and still.sum() > 4000
    found = cloud.colors[: len(expected)]
    np.testing.assert_allclose(found[still], expected[still], atol=1e-3)


def test_a_reused_cloud_comes_back_to_rest(decoder: Decoder) -> None:
    who, head = identity.load("ada"), turned(5, 20, 5, (3.0, 2.0, 1.0))
    rest, away = skin(decoder, "ada", HeadPose()), skin(decoder, "ada", head, breath=0.5)
    for pose, breath, wanted in ((head, 0.5, away), (HeadPose(), 0.0, rest), (head, 0.5, away)):
        _, cloud = decoder.decode(STILL, AHEAD, who, pose, breath, reuse=True)
        for name in FIELDS:
            np.testing.assert_array_equal(getattr(cloud, name), getattr(wanted, name))


def test_the_mesh_stays_at_rest(decoder: Decoder) -> None:
    who = identity.load("ben")
    rest = decoder.decode(STILL, AHEAD, who)[0].vertices
    now = decoder.decode(STILL, AHEAD, who, turned(10, 20, 5))[0].vertices
    np.testing.assert_array_equal(rest, now)


def test_a_breath_lifts_the_chest_alone(decoder: Decoder) -> None:
    share = along(decoder, "ben")
    rest, now = skin(decoder, "ben", HeadPose()), skin(decoder, "ben", HeadPose(), breath=1.0)
    moved = (now.means - rest.means)[: len(share)]
    assert 1 < moved[share < 1e-6, 1].mean() < 3
    assert np.abs(moved[share > 0.9999]).max() < 1e-2


def test_a_neck_has_limits_and_is_free_inside_them() -> None:
    small = turned(20, 35, -15, (5.0, -5.0, 5.0))
    assert limited(small).quat == small.quat and limited(small).position == small.position
    far = limited(turned(80, 170, 120, (900.0, 0.0, 0.0)))
    assert max(far.position) <= LIMIT_MM
    for angle, limit in zip(rotation.to_angles(far.quat), LIMITS_RAD, strict=True):
        assert abs(angle) <= limit + 1e-6
    steps = [degrees(rotation.to_angles(limited(turned(0, yaw, 0)).quat)[1]) for yaw in range(90)]
    assert (np.diff(steps) > 0).all()
