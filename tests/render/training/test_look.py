"""How people are made to look: skin beside hair, around eyes."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from render import clothes
from render.avatars import hairline
from render.lighting import LUMINANCE, TOWARDS
from render.training.data.face_data import EYE_PICTURE_DEG
from render.training.look import eyes, lids, skin
from render.training.look.places import Places, soft

SKIN = np.array([0.7, 0.5, 0.4], np.float32)
ROOT = np.array([0.1, 0.1, 0.1], np.float32)


def test_skin_under_strands_has_the_colour_of_roots() -> None:
    hair = np.random.default_rng(0).uniform(-4, 4, (200, 3)).astype(np.float32)
    points = np.array([[0, 0, 0], [7, 0, 0], [30, 0, 0]], np.float32)
    under, edge, far = hairline.rooted(np.tile(SKIN, (3, 1)), points, hair, ROOT)
    np.testing.assert_allclose(under, SKIN + hairline.ROOTS * (ROOT - SKIN), atol=1e-3)
    np.testing.assert_array_equal(far, SKIN)
    assert (edge < SKIN).all() and (edge > under).all()


def test_hair_keeps_light_from_behind_off_the_skin_beside_it() -> None:
    hair = np.zeros((50, 3), np.float32)
    points = np.array([[3, 0, 0], [11, 0, 0], [40, 0, 0]], np.float32)
    seen = np.full((4, 3), 0.8, np.float32)
    out = hairline.shaded(seen, points, hair)
    np.testing.assert_array_equal(out[:2], seen[:2])
    np.testing.assert_allclose(out[2:, 0], 0.8 * (1 - hairline.SHADE), rtol=1e-5)
    assert (out[2:, 0] < out[2:, 1]).all() and (out[2:, 1] < 0.8).all()
    np.testing.assert_array_equal(out[:, 2], seen[:, 2])
    behind = np.array([[0, -40, -90]], np.float32)
    nape = hairline.shaded(seen[:, :1], behind, np.tile(behind, (10, 1)))
    assert (nape == seen[:, :1]).all()  # it faces the rims itself
    stray = hairline.shaded(seen, points, np.array([[3, 0, 0], *[[90, 0, 0]] * 9], np.float32))
    np.testing.assert_array_equal(stray, seen)  # one loose hair casts no shadow


def test_corners_of_the_eyes_have_the_hue_of_the_skin_and_stay_as_bright() -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(-20, 20, (3000, 3)).astype(np.float32) * (1, 1, 0)
    edge = np.zeros((1, 3), np.float32)
    near = np.linalg.norm(points, axis=1) < 3
    albedo = np.tile(SKIN, (3000, 1))
    albedo[near] = (0.8, 0.3, 0.3)
    is_skin = points[:, 0] < 2.5  # the rest is eyeball
    out = lids.calmed(albedo, points, is_skin, [edge])
    changed = near & is_skin
    np.testing.assert_allclose(out[changed].sum(1), albedo[changed].sum(1), rtol=1e-5)
    red = out[changed, 0] / out[changed, 1]
    np.testing.assert_allclose(red, lids.MOST * SKIN[0] / SKIN[1], rtol=1e-5)
    np.testing.assert_allclose(out[~changed], albedo[~changed], rtol=1e-5)


def test_lids_are_smooth_skin_without_what_was_painted_on_them() -> None:
    places = around_a_mouth()
    crust = np.random.default_rng(0).uniform(0.3, 1, places.up.shape)[..., None]
    near = places.off_eyes < lids.AROUND_MM
    painted = (SKIN * np.where(near[..., None], crust, 1)).astype(np.float32)
    out = lids.plain(painted, places)
    on = places.off_eyes < 1
    np.testing.assert_allclose(out[on], SKIN * lids.LID * np.ones((int(on.sum()), 1)), rtol=0.05)
    assert (out[places.off_eyes > lids.PAINTED_MM[1]] == painted[~near][0]).all()


def test_a_lower_lid_has_a_wet_edge_and_an_upper_one_dark_roots() -> None:
    points = np.array([[0, 6, 0], [0, 4, 0], [0, 0, 0], [0, 0, 0]], np.float32)
    is_skin = np.array([True, True, True, False])
    sides = [(points[:1], points[2:3])]
    albedo = np.tile(SKIN, (4, 1))
    upper, between, lower, eyeball = lids.rimmed(albedo, points, is_skin, sides)
    np.testing.assert_allclose(upper, SKIN * lids.ROOTS, rtol=1e-5)
    np.testing.assert_allclose(lower, SKIN * lids.WET, rtol=1e-5)
    np.testing.assert_allclose(between, SKIN, rtol=0.01)
    np.testing.assert_array_equal(eyeball, SKIN)


@pytest.mark.parametrize("name", eyes.COLORS)
def test_an_iris_has_a_black_pupil_and_a_dark_rim(tmp_path: Path, name: str) -> None:
    picture = eyes.picture(SimpleNamespace(folder=tmp_path), name)  # pyright: ignore[reportArgumentType] (all that is read)
    away = np.hypot(*(np.indices((eyes.SIZE, eyes.SIZE)) - eyes.SIZE / 2 + 0.5))
    radius = away / (0.499 * eyes.SIZE) * EYE_PICTURE_DEG / eyes.IRIS_DEG
    light = picture**2 @ LUMINANCE
    pupil, iris, rim, white = (
        light[(radius > a) & (radius < b)].mean()
        for a, b in ((0, 0.25), (0.45, 0.7), (0.86, 0.91), (1.1, 1.6))
    )
    assert pupil < 0.15 * iris and rim < 0.6 * iris and rim < 0.3 * white


def test_strands_cast_a_soft_shadow_and_not_on_skin_they_lie_on() -> None:
    grid = np.stack(np.meshgrid(np.arange(-15, 15, 1.0), np.arange(-15, 15, 1.0)), -1)
    towards = TOWARDS[0]
    skin = np.array([[0, 0, 0], [200, 0, 0]], np.float32)
    hair = (15 * towards + grid.reshape(-1, 2) @ np.linalg.svd(towards[None])[2][1:]).astype("f4")
    seen = np.ones((4, 2), np.float32)
    shaded = hairline.cast(seen, skin, hair)
    below = hairline.cast(seen, skin, np.concatenate([hair, hair - 15 * towards]))
    assert below[1, 0] > 0.9  # it is lit as the hair on it is
    assert 0.35 < shaded[1, 0] < 0.7 and shaded[1, 1] == 1 and (shaded[2:] == 1).all()


def test_the_shade_of_hair_is_less_red() -> None:
    albedo = np.full((2, 3), 0.6, np.float32)
    made = hairline.paler(
        albedo, np.array([0.9, 0.9], np.float32), np.array([0.9, 0.3], np.float32)
    )
    np.testing.assert_allclose(made[0], 0.6, rtol=1e-6)
    assert made[1, 0] < 0.56 and made[1, 2] > 0.6
    brought_out = hairline.paler(albedo[:1], np.zeros(1, np.float32), np.ones(1, np.float32))
    np.testing.assert_allclose(brought_out, 0.6, rtol=1e-6)  # whites of eyes stay white


def test_a_collar_shades_the_skin_above_it_and_not_the_cloth() -> None:
    points = np.array([[0, y, -40] for y in (-120, -111, -90, -40)], np.float32)
    seen = clothes.shaded(np.ones((4, 4), np.float32), points)
    assert (seen[:, 0] == 1).all() and (seen[:, 3] == 1).all()
    assert (seen[2:, 1] < 0.3).all() and (seen[:2, 1] < 0.85).all()
    assert (seen[:2, 2] == 1).all() and (seen[2:, 2] > 0.5).all() and (seen[2:, 2] < 0.95).all()


def around_a_mouth() -> Places:  # [H, W]
    x, y = np.meshgrid(np.arange(-45, 45, 0.25), np.arange(-5, -75, -0.25))
    at = np.hypot(x / 25, (y + 34) / 9)
    maps = {name: np.zeros(x.shape, np.float32) for name in ("lids", "brows")}
    return Places(
        points=np.stack([x, y, 0 * x + 100], -1).astype(np.float32),
        lips=(at < 1).astype(np.float32),
        face=np.ones(x.shape, np.float32),
        roll=(at < 0.5).astype(np.float32),
        off_eyes=np.hypot(np.abs(x) - 20, y + 34).astype(np.float32),
        **maps,
    )


def test_a_patch_of_another_hue_around_a_mouth_takes_that_of_the_face() -> None:
    places = around_a_mouth()
    patch = soft((np.hypot(places.across - 34, places.up + 60) < 6).astype(np.float32), 4)
    tone = np.where(places.lips[..., None] > 0.5, (0.5, 0.15, 0.14), SKIN).astype(np.float32)
    yellow = (tone * (1 - patch[..., None] * np.array([0.12, 0, 0.3]))).astype(np.float32)
    here, blue = patch > 0.9, SKIN[2] / SKIN[1]
    out = skin.evened(yellow, places)
    np.testing.assert_allclose(out[here] @ LUMINANCE, yellow[here] @ LUMINANCE, rtol=1e-4)
    missing = blue - np.array([at[here, 2] / at[here, 1] for at in (yellow, out)])
    assert missing[1].mean() < 0.6 * missing[0].mean()
    middle = (places.lips > 0.5) & (places.across < 10)
    np.testing.assert_allclose(out[middle], yellow[middle], rtol=0.05)


def test_corners_of_a_mouth_are_not_painted_dark() -> None:
    places = around_a_mouth()
    streak = (np.abs(places.across - 26.5) < 2) & (np.abs(places.up + 34.5) < 1)
    tone = np.where(places.lips[..., None] > 0.5, (0.5, 0.15, 0.14), SKIN).astype(np.float32)
    tone[streak] = (0.12, 0.03, 0.02)
    assert (skin.evened(tone, places)[streak] @ LUMINANCE > 0.55 * (SKIN @ LUMINANCE)).all()


def test_the_inside_of_lips_is_flesh() -> None:
    places = around_a_mouth()
    lip = np.array([0.5, 0.15, 0.14], np.float32)
    tone = np.where(places.lips[..., None] > 0.5, lip, SKIN).astype(np.float32)
    tone[places.roll > 0.5] = 0.02
    out = skin.fleshed(tone, places)
    inside = np.hypot(places.across / 25, (places.up + 34) / 9) < 0.4
    assert (out[inside] @ LUMINANCE > 0.75 * (lip @ LUMINANCE)).all()
    np.testing.assert_array_equal(out[places.up > -10], tone[places.up > -10])


def test_painted_brows_leave_no_shadow_below() -> None:
    """What fills them is skin, not the dark edge of a lid next to them."""
    x, y = np.meshgrid(np.arange(-60, 60, 0.25), np.arange(75, 15, -0.25))
    eye = np.hypot((np.abs(x) - 32) / 12, (y - 31) / 5) < 1
    none = np.zeros(x.shape, np.float32)
    points = np.stack([x, y, 0 * x + 90], -1).astype(np.float32)
    brows = ((y > 37) & (np.abs(x) > 8)).astype(np.float32)
    places = Places(points, none, eye.astype(np.float32), brows, none + 1, none, none + 20)
    tone = np.tile(SKIN, (*x.shape, 1))
    tone[eye] *= 0.5
    tone[
        (np.abs(y - 44) < 2.5) & (np.abs(np.abs(x) - 34) < 18) & ((4 * x).astype(int) % 2 == 0)
    ] = 0.05
    out = skin.shaven(tone, places)
    np.testing.assert_allclose(out[y > 39], np.tile(SKIN, ((y > 39).sum(), 1)), rtol=0.08)
    below = (y < 32) & (np.abs(x) < 43)
    np.testing.assert_array_equal(out[below], tone[below])
