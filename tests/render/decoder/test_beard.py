"""Beards stand on the skin: they go with jaw and lips, and fit another face."""

from dataclasses import replace

import numpy as np

from render.decoder import beard, identity
from render.decoder.decoder import EXPRESSION_DIM, Decoder
from render.types import AHEAD, Gaussians

STILL = np.zeros(EXPRESSION_DIM, np.float32)


def grown(cloud: Gaussians, who: identity.Identity) -> slice:
    return slice(len(cloud) - len(who.beard), len(cloud))


def axis(quats: np.ndarray) -> np.ndarray:  # [n, 4] -> [n, 3]: where x is turned to
    w, x, y, z = (quats / np.linalg.norm(quats, axis=1, keepdims=True)).T
    return np.stack([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)], 1)


def test_a_beard_goes_with_the_jaw(decoder: Decoder) -> None:
    who = identity.load("hugo")
    assert len(who.beard) > 1000
    rig = np.zeros(len(decoder.rig_names), np.float32)
    rig[decoder.rig_names.index("jawOpen")] = 0.6
    shut = decoder.decode(STILL, AHEAD, who)[1]
    opened = decoder.decode(decoder.encode(rig), AHEAD, who)[1]
    before, after = (cloud.means[grown(cloud, who)] for cloud in (shut, opened))
    chin = (before[:, 1] < -75) & (np.abs(before[:, 0]) < 15)
    assert np.median(after[chin, 1] - before[chin, 1]) < -8
    temples = before[:, 1] > -20
    assert np.median(np.abs(after[temples] - before[temples])) < 1.5


def test_strands_stand_where_and_as_they_were_grown(decoder: Decoder) -> None:
    who = identity.load("hugo")
    mesh, cloud = decoder.decode(STILL, AHEAD, who)
    worn, rows = who.beard, grown(cloud, who)
    frames = beard.frames(mesh.vertices, worn.corners)
    roots = (mesh.vertices[worn.corners] * worn.shares[..., None]).sum(1)
    means = roots + np.einsum("nij,nj->ni", frames, worn.offsets)
    np.testing.assert_allclose(cloud.means[rows], means, atol=1e-3)
    along = np.einsum("nij,nj->ni", frames, worn.along)
    turned = along[:, 0] > -0.9  # straight backward any turn would do
    np.testing.assert_allclose(axis(cloud.quats[rows])[turned], along[turned], atol=2e-3)


def test_the_shaven_have_nothing_more(decoder: Decoder) -> None:
    who = identity.load("hugo")
    shaven = replace(who, beard=beard.none())
    more, less = (decoder.decode(STILL, AHEAD, x)[1] for x in (who, shaven))
    np.testing.assert_array_equal(more.means[: len(less)], less.means)
    assert len(more) - len(less) == len(who.beard)


def test_a_beard_survives_its_file_and_fits_another_face(decoder: Decoder, tmp_path) -> None:
    lender, wearer = identity.load("hugo"), identity.load("ada")
    identity.save(replace(wearer, name="new", beard=lender.beard), tmp_path, {"command": "test"})
    who = identity.load("new", tmp_path)
    assert np.abs(who.beard.offsets - lender.beard.offsets).max() < 0.11
    mesh, cloud = decoder.decode(STILL, AHEAD, who)
    roots = (mesh.vertices[who.beard.corners] * who.beard.shares[..., None]).sum(1)
    away = np.linalg.norm(cloud.means[grown(cloud, who)] - roots, axis=1)
    assert away[roots[:, 1] > -120].max() < 16  # the rest is cloth, which hangs below the bust
