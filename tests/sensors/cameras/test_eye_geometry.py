"""Profiles of real eye cameras: which pixel of the device ends where in which eye's view."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sensors.cameras import views as cameras_views
from sensors.cameras.geometry import (
    PROFILES,
    EyeGeometry,
    normalise_exposure,
    parse,
    profile,
    views_of,
)
from sensors.cameras.spec import parse as parse_spec
from sensors.picture import BadPictureError
from sensors.types import InputError


def picture(height: int, width: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (height, width), dtype=np.uint8)


def views(geometry: EyeGeometry, image: np.ndarray, camera: int = 0) -> dict[int, np.ndarray]:
    return dict(replace(geometry, exposure=False).views(image, camera))


def test_the_named_devices_are_there() -> None:
    names = {"bigscreen-beyond-2e", "eyetrackvr", "vive-facial-tracker", "custom"}
    assert set(PROFILES) == names and all(profile(n).name == n for n in names)


def test_side_by_side_is_split() -> None:
    image = picture(400, 800)
    eyes = views(profile("bigscreen-beyond-2e"), image)
    assert np.array_equal(eyes[0], image[:, :400]) and np.array_equal(eyes[1], image[:, 400:])


def test_each_view_is_cut_and_scaled_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Red before: twice, for either eye both."""
    sizes, whole = [], cameras_views.fit
    monkeypatch.setattr(cameras_views, "fit", lambda view: sizes.append(view.shape) or whole(view))
    views(profile("custom"), picture(240, 640))
    assert sizes == [(240, 320)] * 2


def test_swap_exchanges_the_eyes_and_keeps_each_eyes_own_turn() -> None:
    image = picture(400, 800)
    geometry = replace(profile("custom"), swap=True, turns=(1, 0), mirror=(False, True))
    eyes = views(geometry, image)
    assert np.array_equal(eyes[0], np.rot90(image[:, 400:]))  # left eye: turned
    assert np.array_equal(eyes[1], image[:, :400][:, ::-1])  # right eye: mirrored


def test_one_camera_an_eye() -> None:
    image = picture(240, 240)
    eyetrackvr = profile("eyetrackvr")
    assert set(views(eyetrackvr, image)) == {0} and set(views(eyetrackvr, image, 1)) == {1}
    assert set(views(replace(eyetrackvr, swap=True), image)) == {1}
    assert views(eyetrackvr, image)[0].shape == (400, 400)


def test_narrow_views_are_stretched() -> None:
    image = np.zeros((400, 400), np.uint8)
    image[:, 50:150] = 200  # the middle half of the left view
    eyes = views(profile("vive-facial-tracker"), image)
    assert eyes[0].shape == eyes[1].shape == (400, 400) and eyes[1].max() == 0
    assert eyes[0][:, 120:280].min() == 200 and eyes[0][:, :80].max() == 0


def test_crop_comes_first() -> None:
    image = picture(480, 1000)
    eyes = views(replace(profile("custom"), crop=(100, 40, 800, 400)), image)
    assert np.array_equal(eyes[1], image[40:440, 500:900])
    with pytest.raises(BadPictureError, match="beyond the picture of 1000 x 480"):
        views(replace(profile("custom"), crop=(100, 40, 901, 400)), image)
    with pytest.raises(BadPictureError):
        views(replace(profile("custom"), crop=(990, 0, 10, 10)), image)


def test_exposure_brings_dim_and_bright_views_together() -> None:
    scene = np.linspace(0, 1, 160_000).reshape(400, 400) ** 1.5
    dim, bright = ((base + scale * scene).astype(np.uint8) for base, scale in ((10, 60), (60, 180)))
    levels = [np.percentile(normalise_exposure(v), (10, 50, 90)) for v in (dim, bright)]
    assert np.abs(levels[0] - levels[1]).max() < 8
    assert np.abs(np.percentile(dim, 50) - np.percentile(bright, 50)) > 50  # they were apart


def test_exposure_does_not_raise_the_dead() -> None:
    noise = picture(400, 400) % 6  # a covered lens
    assert normalise_exposure(noise).max() < 32
    assert normalise_exposure(np.zeros((400, 400), np.uint8)).max() == 0
    assert np.isfinite(normalise_exposure(np.full((400, 400), 255, np.uint8))).all()


def test_each_view_is_normalised_by_itself() -> None:
    scene = picture(400, 400) // 4
    image = np.hstack([scene, 3 * scene + 40]).astype(np.uint8)
    eyes = dict(profile("bigscreen-beyond-2e").views(image))
    assert abs(scene.mean() - (3 * scene + 40).mean()) > 90
    assert abs(eyes[0].mean() - eyes[1].mean()) < 20


def test_saved_profiles_come_back(tmp_path: Path) -> None:
    geometry = replace(profile("eyetrackvr"), turns=(1, 3), crop=(1, 2, 300, 300), swap=True)
    geometry.save(tmp_path / "p.json")
    assert EyeGeometry.load(tmp_path / "p.json") == geometry


@pytest.mark.parametrize(
    "words, expected",
    [
        ({"swop": True}, "swap"),
        ({"turns": [1]}, "two whole numbers"),
        ({"turns": [True, False]}, "two whole numbers"),
        ({"crop": [1, 2, 3, -4]}, "four whole numbers"),
        ({"mirror": "yes"}, "true and false"),
        ([1], "object"),
    ],
)
def test_bad_profiles_are_one_line(words: object, expected: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=expected):
        parse(json.loads(json.dumps(words)), "p.json")
    (tmp_path / "p.json").write_text("{")
    with pytest.raises(InputError, match="bigscreen-beyond-2e"):
        EyeGeometry.load(tmp_path / "p.json")
    with pytest.raises(InputError, match="try eyetrackvr"):
        profile("eyetrackr")


def test_a_spec_names_its_profile(tmp_path: Path) -> None:
    image = picture(400, 800)
    spec = parse_spec("usb:35bd:0202#profile=bigscreen-beyond-2e")
    known = profile("bigscreen-beyond-2e")
    expected = known.views(image)
    assert spec.views.eyes == (0, 1)
    for (eye, view), (other, same) in zip(expected, spec.views.cut(image), strict=True):
        assert eye == other and np.array_equal(view, same)
    replace(profile("custom"), swap=True, exposure=False).save(tmp_path / "mine.json")
    mine = parse_spec(f"uvc:0#profile={tmp_path / 'mine.json'}")
    assert np.array_equal(dict(mine.views.cut(image))[0], image[:, 400:])
    with pytest.raises(InputError, match="expected one of"):
        parse_spec("uvc:0#profile=nothing")


def test_a_profile_says_how_many_cameras() -> None:
    with pytest.raises(InputError, match="two cameras"):
        views_of(profile("eyetrackvr"), (0, 1))
    with pytest.raises(InputError, match="one camera"):
        views_of(profile("bigscreen-beyond-2e"), (0,))
    assert views_of(replace(profile("eyetrackvr"), swap=True), (0,)).eyes == (1,)
    right = views_of(profile("eyetrackvr"), (1,))
    assert right.eyes == (1,) and [eye for eye, _ in right.cut(picture(240, 240))] == [1]
