"""What a photographed person wears: the lender's shirt whole, and of a beard's lender the beard."""

import numpy as np
import pytest

from render.avatars.maker import Maker
from render.avatars.photos import dress
from render.decoder import identity, mesh_parts
from render.lighting import LUMINANCE


@pytest.fixture(scope="module")
def maker() -> Maker:
    return Maker()


def test_the_shirt_has_a_collar_on_an_even_line(maker: Maker) -> None:
    """Red before: cloth was where the lender has no gloss, so its edge was ragged, and ended in
    nothing."""
    ben, ada = identity.load("ben"), identity.load("ada")
    worn = dress.dressed(maker, ben, ada)
    assert 1000 < len(worn.beard) - len(ben.beard) < 2500
    added = worn.beard.take(np.arange(len(worn.beard)) >= len(ben.beard))
    heights = dress.above_neckline(maker, added)
    assert heights.max() < dress.COLLAR_MM and (np.abs(heights) < 6).sum() > 800
    lent = ada.beard.take(dress.above_neckline(maker, ada.beard) < dress.COLLAR_MM)
    lifted = added.offsets - lent.offsets  # red before: on other necks the seam was dashes
    np.testing.assert_allclose(lifted, np.tile([0, 0, dress.LIFT_MM], (len(lent), 1)), atol=1e-5)
    head = maker.surface
    points = head.interpolate @ maker.template[head.used]
    low = (points[:, 1] < -140) & (maker.anchor_kinds == mesh_parts.SKIN)
    np.testing.assert_allclose(worn.albedo[low], ada.albedo[low], atol=1e-6)
    assert not worn.gloss[low].any()
    high = points[:, 1] > -100
    np.testing.assert_array_equal(worn.gloss[high], ben.gloss[high])


def test_skin_under_a_shirt_is_thicker_and_a_face_is_not(maker: Maker) -> None:
    geometry = identity.load("lena").geometry
    moved = np.linalg.norm(dress.padded(maker, geometry) - geometry, axis=1)
    high = maker.template[:, 1] > -100
    assert not moved[high].any()
    assert moved.max() == pytest.approx(2.2, abs=0.01)


@pytest.mark.parametrize(("name", "least", "most"), [("hugo", 9000, 13_000), ("ada", 0, 0)])
def test_a_beard_comes_without_the_brows_and_the_shirt(
    maker: Maker, name: str, least: int, most: int
) -> None:
    """Red before: whoever wore hugo's beard had his brows, lashes and collar, too, and no lashes
    of their own."""
    ben = identity.load("ben")
    worn = dress.bearded(maker, ben, identity.load(name)).beard
    assert least <= len(worn) - len(ben.beard) <= most
    for field in ("corners", "offsets"):
        np.testing.assert_array_equal(getattr(worn, field)[: len(ben.beard)],
                                      getattr(ben.beard, field))  # fmt: skip
    grown = worn.take(np.arange(len(worn)) >= len(ben.beard))
    assert not len(grown) or dress.above_neckline(maker, grown).min() >= dress.COLLAR_MM


def test_skin_under_a_lent_beard_is_as_dark_as_the_lender_s(maker: Maker) -> None:
    """Red before: strands stood on skin as pale as that of a shaven face, and looked sparse."""
    emil, hugo = identity.load("emil"), identity.load("hugo")
    worn = dress.bearded(maker, emil, hugo)
    head = maker.surface
    points = head.interpolate @ maker.template[head.used]
    skin = maker.anchor_kinds == mesh_parts.SKIN
    chin = skin & (np.abs(points[:, 0]) < 12) & (np.abs(points[:, 1] + 70) < 8)
    chin &= points[:, 2] > 60
    before, after, lent = (np.median(w.albedo[chin]) for w in (emil, worn, hugo))
    assert after < 0.75 * before and after == pytest.approx(lent, rel=0.25)
    above = points[:, 1] > 25
    np.testing.assert_array_equal(worn.albedo[above], emil.albedo[above])
    np.testing.assert_array_equal(dress.bearded(maker, emil, emil).albedo, emil.albedo)


def test_roots_of_dyed_hair_have_its_hue(maker: Maker) -> None:
    """Red before: below white hair that was dark a scalp was blue: roots are greyer than hair."""
    ben, white = identity.load("ben"), np.array([0.5, 0.42, 0.34])
    at = dress.roots(maker, ben) > 0.9
    dyed = dress.dyed(maker, ben, white)
    root = np.median(dyed.albedo[at].astype(np.float64) ** 2, 0)
    np.testing.assert_allclose(root / root[0], white / white[0], atol=0.1)
    hair, before = (np.median(w.hair.albedo**2, 0).mean() for w in (dyed, ben))
    own = np.median(ben.albedo[at] ** 2, 0).mean()
    assert root.mean() / hair == pytest.approx(own / before, rel=0.3)


@pytest.mark.parametrize("name", ["greta", "emil", "lena"])
def test_light_hair_dyed_black_leaves_no_light_scalp(name: str, maker: Maker) -> None:
    """Red before: a fringe as of chalk at the hairline, and a patch on the crown."""
    lender = identity.load(name)
    dyed = dress.dyed(maker, lender, np.array([0.01, 0.01, 0.01]))
    crown = dress.anchors(maker)[:, 1] > dress.SCALP_MM[1] + 20
    crown &= maker.anchor_kinds == mesh_parts.SKIN
    before, after = (np.median(who.albedo[crown] @ LUMINANCE) for who in (lender, dyed))
    assert after < 0.75 * before
    assert np.abs(dyed.albedo - lender.albedo)[maker.face].mean() < 0.02
