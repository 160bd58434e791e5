"""Gaussians that nothing shows: told from those that are seen, and taken out of a prior."""

import numpy as np
import pytest

from render.cameras import portrait
from render.decoder import prior_file
from render.decoder.decoder import Decoder
from render.decoder.learned import weights_file
from render.training.geometry import hidden
from render.training.prior_tensors import without
from render.types import AHEAD, Gaussians

CAMERA = portrait(512, 512, 0, 0, target_mm=(0, 0, 0))


def discs(opacities: list[float]) -> Gaussians:
    """Round ones in the middle of the picture, the wider the nearer."""
    count = len(opacities)
    means, still = np.zeros((count, 3), np.float32), np.zeros((count, 4), np.float32)
    means[:, 2], still[:, 0] = 50 * np.arange(count), 1
    sizes = np.repeat(10.0 ** np.arange(count, dtype=np.float32)[:, None], 3, 1)
    colors = np.zeros((count, 3), np.float32)
    return Gaussians(means, still, sizes, np.array(opacities, np.float32), colors)


def test_the_share_of_a_pixel_is_what_those_before_it_let_through() -> None:
    shares = hidden.shares(discs([0.9, 0.5, 0.8]), 3, CAMERA)
    assert shares == pytest.approx([0.9 * 0.5 * 0.2, 0.5 * 0.2, 0.8], rel=0.2)
    assert hidden.shares(discs([0.9, 0.99]), 2, CAMERA)[0] < hidden.LEAST


def test_hair_hides_nothing() -> None:
    cloud = discs([0.9, 0.99])  # the second is no part of the head
    assert hidden.shares(cloud, 1, CAMERA) == pytest.approx([0.9], rel=0.1)


def test_faces_look_everywhere_and_show_the_depths_of_a_mouth(decoder: Decoder) -> None:
    rigs, gazes, views = zip(*hidden.faces(decoder), strict=True)
    names = [*decoder.rig_names, *hidden.TONGUE]
    assert len(rigs) == 1 + len(hidden.POSES) + len(hidden.GAZES_DEG)
    assert all(len(rig) == len(names) and rig.min() >= 0 for rig in rigs)
    shown = np.max(rigs, 0)
    for name in ("jawOpen", "eyeBlink_L", "eyeBlink_R", "mouthUpperUp_L", "tongueBackUp"):
        assert shown[names.index(name)] == 1, name
    assert all(np.linalg.norm(gaze, axis=1) == pytest.approx(1) for gaze in gazes)
    assert len(views[0]) > len(views[1]) > len(views[-1])


def test_a_prior_without_some_anchors_decodes_the_others_as_before() -> None:
    tensors, card = weights_file.load(weights_file.FOLDER / "prior", prior_file.KIND)
    inside = np.flatnonzero(tensors["anchor_inside"])[::2]
    fewer = without(tensors, inside)
    count = len(tensors["anchor_triangles"]) - len(inside)
    assert {len(fewer[name]) for name in fewer if name.startswith("anchor_")} == {count}
    eyes = int((fewer["anchor_kinds"] == 1).sum())
    assert {len(fewer[name]) for name in fewer if name.startswith("eye.")} == {eyes}
    corners = tensors["faces"].astype(int)[fewer["anchor_triangles"]]
    used = np.unique(corners)
    assert len(fewer["places"]) == len(used) < len(tensors["places"])
    before = prior_file.parts(tensors, card)
    after = prior_file.parts(fewer, {**card, "sha256": "fewer"})
    was, now = before["surface"], after["surface"]
    stay = np.isin(was.used, used)
    np.testing.assert_array_equal(was.used[stay], now.used)
    old, new = before["teeth_light"], after["teeth_light"]
    assert set(now.used[new.rows]) == set(was.used[old.rows]) & set(used)


def test_what_is_seen_of_a_face(decoder: Decoder) -> None:
    from render.decoder import identity

    _, cloud = decoder.decode(np.zeros(256, np.float32), AHEAD, identity.load("hugo"))
    count = len(decoder.surface.depths)
    shares = hidden.shares(cloud, count, portrait(256, 256, 0, 0))
    places = cloud.means[:count]
    assert shares[places[:, 2] > 105].max(initial=0) > 0.5  # a nose
    behind = (places[:, 2] < -60) & (np.abs(places[:, 0]) < 30) & (places[:, 1] > 20)
    assert shares[behind].max(initial=0) < 0.05
