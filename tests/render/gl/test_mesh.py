"""The textured mesh renderer: what it draws, and that numpy's light is the shader's."""

import numpy as np
import pytest

from render import lighting, wrinkles
from render.cameras import portrait
from render.decoder import mesh_parts
from render.decoder.lines import Line
from render.gl.mesh_renderer import MeshRenderer, clip_matrix
from render.gl.occlusion import Occlusion
from render.lighting import Lighting
from render.types import Floats

SPAN = 100.0  # mm, half the side of the test's square


def square(kind: int) -> mesh_parts.Parts:
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)
    return mesh_parts.build(faces, faces, uv, np.full(2, kind, np.int32))


CORNERS = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32) * SPAN


def draw(
    context,
    normal,
    color=(0.6, 0.5, 0.4),
    seen=(0.7, 0.4, 0.3, 0.6),
    lights: Lighting | None = None,
    kind: int = mesh_parts.COLOURED,
    lids: list[Floats] | None = None,
    size: int = 64,
):
    renderer = MeshRenderer(context, square(kind))
    for name in ("skin", "eye"):
        renderer.set_texture(name, np.ones((4, 4, 3), np.float32))
    rows = [np.tile(np.array(v, np.float32), (4, 1)) for v in (normal, color, seen)]
    lights = lights or lighting.STUDIO
    return renderer.draw(CORNERS, *rows, portrait(size, size), lights, False, lids=lids)


@pytest.mark.parametrize("direction", [(0, 0, 1), (0.5, 0.5, 0.7), (-0.8, 0.1, 0.6), (0, 1, 0)])
@pytest.mark.parametrize("name", lighting.LIGHTINGS)
def test_shader_and_numpy_see_the_same_light(egl_context, direction, name):
    lights = lighting.LIGHTINGS[name]
    normal = np.array(direction, np.float32) / np.linalg.norm(direction)
    picture = draw(egl_context, normal, lights=lights)
    seen = np.float32([[0.7, 0.4, 0.3, 0.6]])
    light = lights.shade(normal[None].astype(np.float32), seen)[0]
    expected = lighting.developed(np.float32([0.6, 0.5, 0.4]) ** 2 * light)
    np.testing.assert_allclose(picture[32, 32] / 255, expected, atol=1.5 / 255)


def test_lids_shade_the_eye_as_the_decoder_does(egl_context):
    """Of both eyes, by the height below the edge of the lid: the shader's rule is numba's."""
    x = np.linspace(-SPAN, SPAN, 24, dtype=np.float32)
    opening = np.stack([x, 6 + 0 * x, -9 + 0 * x], 1).astype(np.float32)  # mm
    away = opening + np.float32([3 * SPAN, 0, 0])  # the other eye
    shaded, bare = (
        draw(egl_context, (0, 0, 1), (0.6, 0.6, 0.6), kind=mesh_parts.EYE, lids=lids, size=640)
        for lids in ([away, opening], None)
    )
    rows = np.array([340, 345, 352, 360])
    heights = 15 + 0.5 * (319.5 - rows)  # half a millimetre a pixel there
    points = np.stack([0 * heights, heights, 0 * heights], 1)
    points = np.concatenate([points, [[-SPAN, 0, 0], [SPAN, 0, 0]]]).astype(np.float32)
    vertices = np.concatenate([opening[:, [0, 1, 1]], opening[:, [0, 2, 2]]])
    side = np.arange(24, dtype=np.int32)
    line = Line(side, side + 24, side[:, None], x, side, x, x)
    gains = np.ones((len(points), 3), np.float32)
    line.tint_covered(vertices, points, np.arange(len(points)), np.ones(3, np.float32), gains)
    assert (heights < 6).all() and (heights > -9).all() and gains[0].max() < 0.85
    np.testing.assert_allclose(shaded[rows, 320], bare[rows, 320] * gains[: len(rows)], atol=2)


def test_the_square_lies_where_the_camera_says(egl_context):
    picture = draw(egl_context, (0, 0, 1))
    drawn = np.abs(picture.astype(int) - picture[0, 0]).max(2) > 8
    rows, columns = np.flatnonzero(drawn.any(1)), np.flatnonzero(drawn.any(0))
    # 320 mm over 64 px at the target, which lies 15 mm up: 5 mm a pixel.
    assert (columns[0], columns[-1]) == (12, 51)
    assert (rows[0], rows[-1]) == (15, 54)


def test_clip_matrix_agrees_with_the_camera():
    camera = portrait(320, 200, yaw_deg=20, pitch_deg=10)
    point = np.array([10.0, -20.0, 30.0, 1.0])
    clip = clip_matrix(camera) @ point
    eye = camera.viewmat @ point
    pixel = camera.K @ eye[:3] / eye[2]
    expected = (2 * pixel[0] / 320 - 1, 2 * pixel[1] / 200 - 1)
    np.testing.assert_allclose(clip[:2] / clip[3], expected, atol=1e-9)


def test_a_roof_takes_the_sky_and_the_key_light(egl_context):
    """A vertex under a wide roof sees less sky and no key light; one in the open sees all.

    Whatever was drawn before: splats leave blending on.
    """
    egl_context.gl.enable_only(egl_context.gl.BLEND)
    egl_context.gl.blend_func = egl_context.gl.ONE, egl_context.gl.ONE_MINUS_SRC_ALPHA
    ground = np.array([[0, 0, 0], [4, 0, 0], [0, 0, 4], [150, 0, 0], [154, 0, 0], [150, 0, 4]])
    roof = 10 * np.array([[-4, 1, -4], [4, 1, -4], [4, 1, 6], [-4, 1, 6]])
    vertices = np.concatenate([ground, roof]).astype(np.float32)
    faces = np.array([[0, 2, 1], [3, 5, 4], [6, 8, 7], [6, 9, 8]], np.int32)
    up = np.tile(np.float32([0, 1, 0]), (len(vertices), 1))
    seen = Occlusion(egl_context, faces)(vertices, up)
    assert seen.shape == (len(vertices), 4)  # sky, key light, rims
    assert seen[0, 1] == 0 and seen[0, 0] < 0.5
    assert seen[3, 1] == 1 and seen[3, 0] > 0.9
    sides = np.array([[0, 1, 0], [1, 0.01, 0], [0, 0.1, -1]])  # above, from the side, from behind
    sides = sides / np.linalg.norm(sides, axis=1, keepdims=True)
    reached = Occlusion(egl_context, faces).from_sides(vertices, up, sides)
    np.testing.assert_array_equal(reached[[0, 3]], [[0, 1, 1], [1, 1, 1]])


def test_folds_darken_the_side_that_an_expression_folds(egl_context):
    """Texture, sides and tint of the shader are those of the decoder."""
    renderer = MeshRenderer(egl_context, square(mesh_parts.SKIN))
    for name in ("skin", "eye"):
        renderer.set_texture(name, np.full((4, 4, 3), 0.6, np.float32))
    maps = np.zeros((8, 8, 4), np.float32)
    maps[..., 2] = 0.3
    renderer.set_texture("wrinkles", maps)
    names = sorted({f"{n}_{s}" for kind in wrinkles.KINDS for n in kind for s in "LR"})
    rig = np.zeros(len(names), np.float32)
    rig[names.index("eyeSquint_L")] = 1
    folds = wrinkles.build(
        maps[0, :2], np.float32([40, -40]), names, len(names)
    )  # to the left, to the right
    rows = [np.tile(np.float32(v), (4, 1)) for v in ((0, 0, 1), (1, 1, 1), (1, 0, 0, 0))]
    amounts = wrinkles.amounts(rig, folds.from_rig)
    folded, bare = (
        renderer.draw(CORNERS, *rows, portrait(64, 64), mirrors=False, folds=f)
        for f in (amounts, None)
    )
    expected = np.full((2, 3), 0.6, np.float32)
    folds.fold(rig, expected, 1.0)
    light = lighting.exposed(bare[32, 40].astype(np.float32) / 255) / 0.6**2
    left = lighting.developed(expected[0] ** 2 * light)
    np.testing.assert_allclose(folded[32, 40] / 255, left, atol=2 / 255)  # +x is on the right
    assert (folded[32, 24] == bare[32, 24]).all() and (expected[1] == np.float32(0.6)).all()
    assert folded[32, 40, 1] < bare[32, 40, 1] - 15


def test_a_change_of_size_leaves_nothing_behind(egl_context) -> None:
    """Red before: `eval prior` took 42 MB more with every pair of pictures."""
    renderer, made = MeshRenderer(egl_context, square(mesh_parts.COLOURED)), []
    for name in ("skin", "eye"):
        renderer.set_texture(name, np.ones((4, 4, 3), np.float32))
    rows = [np.tile(np.array(v, np.float32), (4, 1)) for v in ((0, 0, 1), (1, 1, 1), (1, 1, 1, 1))]
    for size in (32, 64, 32):
        renderer.draw(CORNERS, *rows, portrait(size, size))
        made.append(renderer._target)  # noqa: SLF001
    gone, also, last = (type(target.mglo).__name__ == "InvalidObject" for target in made)
    assert gone and also and not last
    egl_context.check_errors("after the changes")
