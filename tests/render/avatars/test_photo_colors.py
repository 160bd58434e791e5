"""Colours of a photographed person: the light and the skin's tone, hair, eyes."""

import numpy as np
import pytest

from render.avatars.maker import Maker
from render.avatars.photos import dress
from render.avatars.photos.colors import complete, creases, exposure, eyes, hair, light, whites
from render.avatars.photos.colors.skin import PaintedSkin
from render.avatars.photos.shape import detector, fit
from render.avatars.photos.shape.picture import Photo
from render.avatars.textures import SIZE
from render.cameras import portrait
from render.decoder import identity
from render.decoder.learned import avatar_files
from render.lighting import developed
from render.types import Doubles

ORANGE = np.array([1.3, 1.0, 0.7])
TONE = np.array([0.5, 0.28, 0.21])


@pytest.fixture(scope="module")
def maker() -> Maker:
    return Maker()


def drawn(white: Doubles, iris: Doubles, face: Doubles) -> Photo:
    """Two eyes in a face; linear colours [3] each."""
    points = np.zeros((detector.POINTS, 2))
    turn = np.linspace(0, 2 * np.pi, len(detector.LEFT_EYE), endpoint=False)
    pixels = np.tile(face, (200, 400, 1))
    row, column = np.indices((200, 400))
    for outline, middle, x in (
        (detector.LEFT_EYE, detector.LEFT_IRIS, 300.0),
        (detector.RIGHT_EYE, detector.RIGHT_IRIS, 100.0),
    ):
        points[list(outline)] = np.stack([x + 60 * np.cos(turn), 100 + 25 * np.sin(turn)], 1)
        points[middle : middle + 5] = x, 100
        points[middle + 1 : middle + 5] += [[22, 0], [0, 22], [-22, 0], [0, -22]]
        pixels[70:130, int(x) - 70 : int(x) + 70] = white
        pixels[np.hypot(column - x, row - 100) < 22] = iris
    stored = np.rint(255 * developed(pixels.astype(np.float32))).astype(np.uint8)
    return Photo("", stored, None, points)


def shut(photo: Photo) -> Photo:
    points = photo.points.copy()
    points[:, 1] = 100
    return Photo("", photo.picture, None, points)


def test_the_whites_of_the_eyes_tell_of_the_light() -> None:
    photo = drawn(np.exp(whites.WHITE) * ORANGE, TONE, TONE)
    seen = whites.light(photo)
    assert seen
    np.testing.assert_allclose(seen[0], np.log(ORANGE), atol=0.05)
    assert whites.light(shut(photo)) is None


def test_the_same_skin_is_found_in_white_and_in_orange_light(maker: Maker) -> None:
    """Red before: without the eyes all of the light's colour stayed in the skin, and a face in the
    shade became a dark one, a bright one brighter than anybody's."""
    plain, tint = (
        drawn(np.exp(whites.WHITE) * shine, TONE, TONE) for shine in (np.ones(3), ORANGE)
    )
    lights, tone = exposure.estimate(maker, [plain, tint], [TONE, TONE * ORANGE])
    np.testing.assert_allclose(lights[1] / lights[0], ORANGE, rtol=0.1)
    np.testing.assert_allclose(tone / tone[1], TONE / TONE[1], rtol=0.1)
    np.testing.assert_allclose(tone * lights[0], TONE, rtol=0.1)
    _, alone = exposure.estimate(maker, [shut(tint)], [TONE * ORANGE])
    assert (TONE * ORANGE)[0] / (TONE * ORANGE)[2] > 1.2 * alone[0] / alone[2]
    shade = drawn(np.exp(whites.WHITE) * 0.3, TONE, TONE)
    _, dim = exposure.estimate(maker, [shade], [0.3 * TONE])
    _, dark = exposure.estimate(maker, [plain], [0.3 * TONE])
    assert dim.mean() > 1.3 * dark.mean()
    _, pale = exposure.estimate(maker, [shut(plain)], [6 * TONE])
    palest = max(
        np.log(np.median(identity.load(name).albedo[maker.face] ** 2, 0)).mean()
        for name in avatar_files.shipped()
    )
    assert np.log(pale).mean() == pytest.approx(palest, abs=1e-4)
    _, candle = exposure.estimate(maker, [shut(plain)], [TONE * [1.0, 0.5, 0.0]])
    assert np.isfinite(candle).all()  # red before


def test_grey_brows_and_blue_shade_have_the_warmth_of_hair_and_skin() -> None:
    """Red before: brows were teal beside skin whose photograph was reddish."""
    brow, shade, lips = [0.03, 0.034, 0.032], [0.1, 0.09, 0.12], [0.4, 0.12, 0.15]
    out = light.natural(np.array([brow, shade, lips]), TONE)
    assert out[0, 1] < 0.8 * out[0, 0]
    assert out[1, 2] < 0.8 * out[1, 0]
    np.testing.assert_allclose(out[2], lips)


def test_a_dazzled_place_has_the_hue_of_the_skin_around_and_half_of_its_shine() -> None:
    color, trust = np.tile(TONE, (2 * SIZE * SIZE, 1)), np.ones(2 * SIZE * SIZE)
    spot = np.zeros((SIZE, 2 * SIZE), bool)
    spot[200:204, 300:304] = True
    spot = spot.ravel()
    color[spot], trust[spot] = 1.2, 0
    soft = light.soft_hues(color, trust, np.tile(TONE, (len(color), 1)))
    hue = np.tile(TONE / TONE[0], (int(spot.sum()), 1))
    np.testing.assert_allclose(soft[spot] / soft[spot][:, :1], hue, atol=0.06)
    np.testing.assert_allclose(soft[~spot], color[~spot], rtol=1e-6)
    matte = light.matte(soft, np.tile(TONE, (len(soft), 1)))
    assert matte[spot].mean() < 0.7 * soft[spot].mean()
    np.testing.assert_allclose(matte[~spot], color[~spot], rtol=1e-6)


@pytest.mark.parametrize(
    ("name", "iris"),
    [("brown", (0.1, 0.05, 0.025)), ("blue", (0.17, 0.2, 0.23)), ("green", (0.16, 0.16, 0.08))],
)
def test_the_colour_of_the_eyes(name: str, iris: tuple[float, ...]) -> None:
    photo = drawn(np.exp(whites.WHITE) * ORANGE, np.array(iris) * ORANGE, TONE)
    assert eyes.color([photo], [ORANGE]) == name
    assert eyes.color([shut(photo)], [ORANGE]) == eyes.USUAL


def test_hair_in_a_photograph_dyes_that_of_a_lender(maker: Maker) -> None:
    """Above the forehead is hair where it is not like skin, and not where the picture ends."""
    camera = portrait(512, 512)
    turn = camera.viewmat[:3, :3].astype(np.float64)
    offset = camera.viewmat[:3, 3].astype(np.float64)
    shot = fit.PhotoCamera(turn, offset, float(camera.K[0, 0]), np.zeros(1))
    found = fit.FaceFit(np.zeros((468, 3)), [shot], 1.0)

    def seen(linear: Doubles) -> Doubles | None:
        stored = np.rint(255 * developed(np.tile(linear, (512, 512, 1)).astype(np.float32)))
        photo = Photo("", stored.astype(np.uint8), None, np.zeros((detector.POINTS, 2)))
        skin = PaintedSkin(np.zeros((1, 2, 3), np.float32), [np.ones(3)], TONE)
        return hair.color(maker, [photo], found, maker.template, skin)

    grey = seen(np.array([0.36, 0.4, 0.38]))  # greenish, as cameras and light make it
    assert grey is not None
    np.testing.assert_allclose(grey / grey[0], 1, atol=0.02)
    ginger = seen(np.array([0.3, 0.09, 0.03]))
    assert ginger is not None
    np.testing.assert_allclose(ginger / ginger[0], [1, 0.25, 0.1], atol=0.04)
    assert seen(TONE) is None and seen(1.4 * TONE) is None
    white = seen(2.4 * TONE)  # red before: a lender's blond
    assert white is not None and white.mean() > 0.3
    shot.offset = offset - [0.0, 200.0, 0.0]  # up
    assert seen(np.array([0.3, 0.09, 0.03])) is None
    lender = identity.load("greta")
    dyed = dress.dyed(maker, lender, ginger)
    np.testing.assert_allclose(np.median(dyed.hair.albedo**2, 0), ginger, rtol=0.1, atol=0.005)
    assert np.abs(dyed.albedo - lender.albedo)[maker.face].mean() < 0.02


def test_creases_of_a_smile_are_not_in_the_skin_at_rest(maker: Maker) -> None:
    """Red before: they stayed, and a young man was old. What is dark elsewhere stays."""
    rig = np.zeros(len(maker.rig_names))
    assert not creases.folded(maker, [rig])[0].any()
    rig[[maker.rig_names.index(f"mouthSmile_{side}") for side in "LR"]] = 0.9
    fold = creases.folded(maker, [rig])[0]
    assert 0.001 < (fold > 0.9).mean() < 0.1
    lines = (np.arange(2 * SIZE * SIZE) // (2 * SIZE)) % 20 < 2
    color = np.where(lines, 0.4, 1.0)[:, None] * TONE
    out = creases.smoothed(color, np.ones(len(color)), fold)
    assert out[lines & (fold > 0.9)].mean() > 2 * color[lines].mean()
    np.testing.assert_allclose(out[~lines], color[~lines], rtol=1e-6)
    np.testing.assert_array_equal(out[fold == 0], color[fold == 0])


def test_what_glares_on_one_side_comes_from_the_other() -> None:
    """A jaw before a bright window; a white beard glares on both sides, and is one; skin opposite a
    dark strand of hair does not glare."""
    other = np.array([1, 0, 3, 2, 5, 4, 7, 6])
    color = np.array([TONE, TONE + 0.3, TONE, 1.1 * TONE, *[TONE + 0.4] * 2, 0.2 * TONE, TONE])
    known, usual = np.ones(8), np.tile(TONE, (8, 1))
    trust = complete.believed(color, known, other, usual)
    np.testing.assert_allclose(trust, [1, 0, 1, 1, 1, 1, 1, 1], atol=1e-6)
    known[0] = 0
    np.testing.assert_allclose(complete.believed(color, known, other, usual), 1, atol=1e-6)
