"""The light in a photograph: found among lamps, and taken off."""

import numpy as np
import pytest

from render.avatars.maker import Maker
from render.avatars.photos.colors import complete, light, projection, skin
from render.avatars.textures import SIZE
from render.decoder import mesh_parts
from render.gl.occlusion import sky_directions
from render.types import Doubles

TONE = np.array([0.5, 0.3, 0.22])


@pytest.fixture(scope="module")
def maker() -> Maker:
    return Maker()


def lit_face(maker: Maker) -> tuple[Doubles, Doubles, Doubles]:
    """A face in warm light from one side and dim light from all [N, L], [N, 3], weights [N]."""
    lamps = light.lamps(maker, maker.template, maker.normals(maker.template))
    towards = sky_directions()
    warm = np.maximum(towards @ [0.8, 0.4, 0.45], 0)[:, None] ** 6 * np.array([1.0, 0.8, 0.5])
    brightness = np.concatenate([warm + 0.01, [[0.02, 0.02, 0.02]]])
    return lamps, (lamps @ brightness).astype(np.float64), maker.face.astype(np.float64)


def test_lamps_are_shadowed_by_the_head(maker: Maker) -> None:
    """Light from the left does not reach the right of the nose, though it faces up."""
    lamps, at = (
        light.lamps(maker, maker.template, maker.normals(maker.template)),
        complete.anchors(maker),
    )
    left = int(np.argmax(sky_directions() @ [0.95, 0.25, 0.2]))
    tip = at[maker.face][np.argmax(at[maker.face][:, 2])]
    for side in (1, -1):
        place = tip + [side * 16.0, 0.0, -18.0]
        near = np.linalg.norm(at - place, axis=1)
        near[maker.anchor_kinds != mesh_parts.SKIN] = np.inf
        rows = np.argsort(near)[:20]
        reached = lamps[rows, left].mean()
        assert reached > 0.2 if side > 0 else reached < 0.05


def test_the_light_of_a_face_is_found(maker: Maker) -> None:
    """One skin: its light comes back wherever it is seen, and where it is not; brows do not
    disturb it."""
    lamps, wanted, weight = lit_face(maker)
    typical = np.ones_like(wanted)
    color = wanted * TONE
    brows = maker.surface.share_on(maker.regions["brows"]) > 0.99
    brows &= np.random.default_rng(0).random(len(color)) < 0.3
    color[brows] *= 0.1
    found = light.cast(lamps, color, weight, typical)
    off = np.log(found[maker.face] / (wanted * TONE)[maker.face])
    assert np.abs(np.log(wanted[maker.face] / np.median(wanted[maker.face], 0))).mean() > 0.3
    assert np.abs(off).mean() < 0.03
    few = light.cast(lamps, color, np.zeros(len(color)), typical)  # nothing is seen
    np.testing.assert_array_equal(few, 1)
    red = light.cast(lamps, color * [1.0, 1.0, 0.0], weight, typical)  # red before: NaN
    np.testing.assert_allclose(red, found * [1.0, 1.0, 0.0], atol=0.01)


def test_photographs_in_different_light_show_one_skin(maker: Maker) -> None:
    """Red before: the shadow beside the nose stayed in the skin."""
    from render.avatars import scan_texture

    lamps, wanted, weight = lit_face(maker)
    color = scan_texture.over_atlas(maker, (wanted * TONE).astype(np.float32)).astype(np.float64)
    seen = scan_texture.over_atlas(maker, weight[:, None].astype(np.float32))[:, 0]
    one = projection.Projection(color, seen.astype(np.float64), np.zeros(len(seen), bool))
    typical = np.ones_like(color)
    (out,) = skin.unlit(maker, [one], [lamps], typical, TONE)
    rows = seen > 0.99
    before, after = (np.abs(np.log(c[rows] / np.median(c[rows], 0))).mean() for c in (color, out))
    assert before > 0.3
    assert after < before / 4  # nostrils and the mouth keep some of their darkness
    np.testing.assert_allclose(np.median(out[rows], 0), TONE, rtol=0.05)


def test_what_light_leaves_over_wide_areas_is_evened_but_neither_freckles_nor_beards() -> None:
    row, column = np.indices((SIZE, 2 * SIZE))
    typical = np.tile(TONE, (2 * SIZE * SIZE, 1))
    weight = np.ones(len(typical))
    shade = 0.2 * np.sin(2 * np.pi * column / 300).ravel()[:, None]
    freckles = -0.3 * ((row % 12 < 3) & (column % 12 < 3)).ravel()[:, None]
    out = np.log(light.evened(typical * np.exp(shade + freckles), weight, typical) / typical)
    assert np.abs(out - freckles).mean() < 0.5 * np.abs(shade).mean()
    spots = (freckles < 0).ravel()
    assert out[spots].mean() - out[~spots].mean() == pytest.approx(-0.3, abs=0.02)
    beard = -1.2 * (row > 300).ravel()[:, None]
    out = np.log(light.evened(typical * np.exp(beard), weight, typical) / typical)
    assert out[(row > 360).ravel()].mean() < -1.0
