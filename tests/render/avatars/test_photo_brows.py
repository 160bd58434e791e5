"""Hairs grow where a skin shows brows, and nowhere else."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import KDTree

from render.avatars.maker import Maker
from render.avatars.photos import brows
from render.avatars.photos.colors.complete import anchors
from render.avatars.photos.dress import standing
from render.decoder import beard, identity, mesh_parts
from render.decoder.identity import Identity
from render.gl.contexts import GLContext
from render.lighting import LUMINANCE

pytestmark = pytest.mark.slow

PAINTED_MM, DARKER = 2.5, 0.4


@pytest.fixture(scope="module")
def maker(egl_context: GLContext) -> Maker:
    return Maker(context=egl_context)


@pytest.fixture(scope="module")
def bare() -> Identity:
    """Ada without a hair on her face."""
    return replace(identity.load("ada"), beard=beard.none())


def painted_at(maker: Maker) -> np.ndarray:
    """Gaussians where she has brows."""
    own = identity.load("ada").beard
    at = standing(maker, own)
    lids = maker.template[maker.regions["eyelids"], 1].max()
    on = at[(at[:, 1] > lids + brows.ABOVE_MM) & (at[:, 2] > 0)]
    near = KDTree(on).query(anchors(maker))[0] < PAINTED_MM
    return near & (maker.anchor_kinds == mesh_parts.SKIN)


def test_a_bare_skin_gets_none(maker: Maker, bare: Identity) -> None:
    assert brows.grown(maker, bare) is bare


def test_painted_brows_become_hairs(maker: Maker, bare: Identity) -> None:
    which, albedo = painted_at(maker), bare.albedo.copy()
    albedo[which] *= DARKER
    painted = replace(bare, albedo=albedo)
    made = brows.grown(maker, painted)
    roots = standing(maker, made.beard)
    assert 300 < len(np.unique(roots, axis=0)) < 2000
    left = roots[:, 0] > 0
    assert 0.4 < left.mean() < 0.6
    away = KDTree(anchors(maker)[which]).query(roots)[0]
    assert np.percentile(away, 99) < 3.0
    hair, skin = made.beard.albedo @ LUMINANCE, bare.albedo[maker.face] @ LUMINANCE
    assert np.median(hair) < 0.6 * np.median(skin)
    light, before, after = (one.albedo @ LUMINANCE for one in (bare, painted, made))
    whole = which & (brows.seen(maker, painted, roots.astype(np.float64)).share > 0.9)
    assert (before[whole] < after[whole]).all() and (after[whole] < light[whole]).mean() > 0.99
    far = KDTree(anchors(maker)[which]).query(anchors(maker))[0] > 8
    assert (made.albedo[far] == painted.albedo[far]).all()
    again = brows.grown(maker, painted)
    assert (again.beard.offsets == made.beard.offsets).all()


def test_hairs_lie_along_the_brow(maker: Maker, bare: Identity) -> None:
    """From the nose outward, on either side."""
    albedo = bare.albedo.copy()
    albedo[painted_at(maker)] *= DARKER
    made = brows.grown(maker, replace(bare, albedo=albedo)).beard
    turns = beard.frames(maker.template, made.corners)
    along = np.einsum("nij,nj->ni", turns, made.along)
    side = np.sign(standing(maker, made)[:, 0])
    assert np.median(along[:, 0] * side) > 0.5
    length = np.linalg.norm(made.offsets, axis=1)
    assert length.max() < 8.0
