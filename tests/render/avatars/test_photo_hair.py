"""What hair of the head covers of a photographed face, and what is the face's own: brows, beard."""

from dataclasses import replace

import numpy as np
import pytest

from render.avatars.maker import Maker
from render.avatars.photos import dress
from render.avatars.photos.colors import covered
from render.avatars.photos.colors.covered import HairPlaces
from render.avatars.textures import SIZE
from render.decoder import identity
from render.types import Doubles

TONE = np.array([0.5, 0.3, 0.22])
ROW, COLUMN = np.indices((SIZE, 2 * SIZE))
ASIDE = COLUMN - SIZE


def places() -> HairPlaces:
    """A face in the middle of the atlas, a texel a millimetre; lips from row 150 to 160."""
    jaws = (ROW > 130) & (ROW < 200) & (np.abs(ASIDE) < 180)
    mouth = jaws & (np.abs(ASIDE) < 30)
    row, aside = ROW[jaws], ASIDE[jaws]
    number = np.full(ROW.shape, -1)
    number[jaws] = np.arange(len(row))
    return HairPlaces(
        edge=np.clip((np.abs(ASIDE) - 200.0) / 20, 0, 1).ravel(),
        brows=((ROW > 100) & (ROW < 110) & (np.abs(ASIDE) < 80)).ravel(),
        mouth=mouth.ravel(),
        moustache=(mouth & (ROW < 150)).ravel(),
        lips=(mouth & (ROW >= 150) & (ROW < 160)).ravel(),
        jaws=jaws.ravel(),
        opposite=number[row, SIZE - aside].astype(np.int32),
    )


def skin(*dark: np.ndarray, by: float = 0.05) -> Doubles:
    color = np.tile(TONE, (ROW.size, 1))
    for spots in dark:
        color[spots.ravel()] *= by
    return color


def test_hair_that_hangs_into_the_face_is_no_skin_but_brows_are() -> None:
    """Red before: tips of dark hair stayed beside the brows, as it was looked for at the edge."""
    hanging = (ROW > 100) & (ROW < 130) & (ASIDE > 150)
    brow = (ROW > 100) & (ROW < 110) & (np.abs(ASIDE) < 80)
    joined = (ROW > 100) & (ROW < 104) & (ASIDE > 0) & (ASIDE < 160)
    face = places()
    hair = covered.covered(skin(hanging, brow, joined), TONE, face)
    assert hair[hanging.ravel()].min() == 1
    assert hair[brow.ravel()].max() == 0
    assert hair[~(hanging | joined).ravel() & (face.edge == 0)].mean() < 0.006


BEARD = (ROW > 135) & (ROW < 195) & (np.abs(ASIDE) < 60)
SIDEBURN = (ROW > 180) & (ROW < 190) & (ASIDE > 40)  # on one side, from the beard to the hair


@pytest.mark.parametrize("by", [0.3, 2.0])  # dark, white
def test_a_beard_that_meets_the_hair_is_the_faces_own(by: float) -> None:
    """Red before: goatees that a collar or sideburns joined to the edge were left out in part."""
    face, color = places(), skin(BEARD | SIDEBURN, by=by)
    hair = covered.covered(color, TONE, face)
    assert hair[(BEARD & (np.abs(ASIDE) < 50)).ravel()].max() == 0
    assert hair[(SIDEBURN & (ASIDE > 100)).ravel()].min() == 1
    seen = covered.beard_color([color], [np.ones(ROW.size)], TONE, face)
    np.testing.assert_allclose(seen, TONE * by)


@pytest.mark.parametrize(
    "shade",
    [
        (ROW > 120) & (ASIDE > 10),  # of one side
        (ROW > 165) & (np.abs(ASIDE) < 250),  # of a chin, on both, but not above the lips
    ],
)
def test_shade_is_no_beard(shade: np.ndarray) -> None:
    face, color = places(), skin(shade, by=0.5)
    assert not covered.bearded(color, TONE, face).any()
    assert covered.beard_color([color], [np.ones(ROW.size)], TONE, face) is None


def test_places_of_a_beard_lie_around_the_mouth() -> None:
    maker = Maker()
    at = maker.template.astype(np.float64)
    face = HairPlaces.of(maker, at, np.zeros((468, 3)))
    assert face.lips[maker.regions["lips"]].mean() > 0.9
    assert not (face.mouth & (face.edge > 0.5)).any()
    jaws = at[face.jaws]
    apart = np.linalg.norm(jaws[face.opposite] * (-1, 1, 1) - jaws, axis=1)
    assert np.percentile(apart, 95) < 1


def test_a_lent_beard_takes_the_colour_that_is_seen() -> None:
    maker, ben, hugo = Maker(), identity.load("ben"), identity.load("hugo")
    white = np.array([0.3, 0.28, 0.25])
    worn = dress.bearded(maker, ben, hugo, white)
    added = worn.beard.albedo[len(ben.beard) :].astype(np.float64)
    np.testing.assert_allclose(np.median(added**2, 0), white, rtol=0.1, atol=0.01)
    np.testing.assert_array_equal(worn.albedo, ben.albedo)  # a beard is on that skin already
    own = dress.bearded(maker, ben, hugo)
    assert len(own.beard) == len(worn.beard)
    assert replace(own, beard=worn.beard).albedo.mean() < ben.albedo.mean()
