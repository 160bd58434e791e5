"""The decoder's compiled loops against plain sums over whole arrays."""

import numpy as np
import pytest

from render.avatars import sheet
from render.decoder import identity, mesh_parts
from render.decoder.decoder import Decoder
from render.decoder.kernels import surface as kernels
from render.decoder.surface import FLATNESS, STRETCH, normals_of
from render.lighting import SHEEN, STUDIO, developed
from render.types import AHEAD, FIELDS
from sensors.rotation import REST
from sensors.types import HeadPose


@pytest.fixture(scope="module")
def talking(decoder: Decoder) -> tuple:
    """Someone with the mouth open: identity, code, gaze, mesh and Gaussians on the skin."""
    who = identity.load("ben")
    code = sheet.code(decoder, {"jawOpen": 0.6, "mouthSmile_L": 0.8, "eyeBlink_R": 0.5})
    looking = sheet.gaze(12, -5)
    mesh, cloud = decoder.decode(code, looking, who)
    return who, code, mesh.vertices, cloud


def test_shapes_add_up(decoder):
    """Their steps are finer than the file's half precision."""
    rest, shapes = identity.load("ben").rest, decoder.posing
    rig = np.random.default_rng(0).uniform(0, 1, 55).astype(np.float32)
    rig[shapes.jaw[1]] = 0
    found = shapes.pose(rig, AHEAD, rest) - shapes.pose(0 * rig, AHEAD, rest)
    lines = (shapes.mouth, *shapes.lid_lines)
    repaired = np.concatenate([*shapes.lids, *(line.members for line in lines)])
    free = np.setdiff1d(np.arange(len(found)), repaired)
    moved = (shapes.basis @ rig).reshape(-1, 3)[free]
    np.testing.assert_allclose(found[free], moved, atol=0.005)
    assert np.abs(moved).max() > 10 and len(free) > 20_000


def test_gaussians_lie_on_their_triangles(decoder, talking):
    _, _, vertices, cloud = talking
    surface = decoder.surface
    expected = surface.interpolate @ vertices[surface.used]
    off = np.linalg.norm(cloud.means[: len(expected)] - expected, axis=1)
    np.testing.assert_allclose(off, surface.depths, atol=5e-2)


def test_no_number_is_what_memory_held_before(decoder, monkeypatch):
    """Loops compute with whole rows: denormal numbers in them made a decode five times as slow."""
    handed_on = []
    gaussians = kernels.skin_gaussians
    monkeypatch.setattr(
        kernels, "skin_gaussians", lambda *a: (handed_on.append(a[2].copy()), gaussians(*a))
    )
    monkeypatch.setattr(np, "empty", lambda shape, dtype=float: np.full(shape, 1e-40, dtype))
    who = identity.load("ben")
    decoder.decode(sheet.code(decoder, {"jawOpen": 0.6}), AHEAD, who)
    tiny = np.finfo(np.float32).tiny
    assert handed_on
    assert not any(((one != 0) & (np.abs(one) < tiny)).any() for one in handed_on)


def test_gaussians_face_as_the_skin_does(decoder, talking):
    who, _, vertices, cloud = talking
    surface = decoder.surface
    whole = surface.whole.corners.astype(int)
    gather = mesh_parts.normal_sum(whole, len(vertices))
    moving, resting = (
        mesh_parts.vertex_normals(v, whole, gather) for v in (vertices, who.geometry)
    )
    normals = resting[surface.used]
    normals[surface.live] = moving[surface.used[surface.live]]
    found = normals_of(cloud.quats[: len(decoder.opacities)])
    np.testing.assert_allclose(found, surface.interpolate @ normals, atol=2e-3)
    assert (cloud.quats[: len(found), 3] == 0).all()


def test_widths_follow_what_moves(decoder, talking):
    who, _, vertices, cloud = talking
    surface = decoder.surface

    def areas(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
        a, b, c = (points[corners[:, k].astype(int)] for k in range(3))
        return np.linalg.norm(np.cross(b - a, c - a), axis=1)

    at_rest = areas(who.geometry, surface.whole.corners)[surface.triangle]
    moved = areas(vertices, surface.face.corners)[surface.live_triangle]
    area = np.where(surface.live_triangle < 0, at_rest, moved)
    width = surface.scales * np.clip(np.sqrt(area / surface.rest_areas), *STRETCH)
    found = cloud.scales[: len(width)]
    np.testing.assert_allclose(found, width[:, None] * [1, 1, FLATNESS], rtol=1e-3)
    assert np.abs(moved / surface.rest_areas - 1).max() > 0.3


def test_colours_are_albedo_under_light(decoder, talking):
    who, code, vertices, cloud = talking
    surface = decoder.surface
    seen = decoder.visibility(code, who)
    gap = decoder.posing.mouth.gaps(vertices).max()
    decoder.teeth_light.fill(seen, gap)
    decoder.tongue_light.fill(vertices, who.geometry, seen, gap)
    normals = np.empty((len(surface.used), 3), np.float32)
    static = np.setdiff1d(np.arange(len(surface.used)), surface.live)
    normals[static] = surface.whole.normals(who.geometry)[0][static]
    normals[surface.live], sums, _ = surface.face.normals(vertices)
    gains = np.ones_like(normals)
    gains[surface.live] = surface.flush(sums, surface.face.normals(who.geometry)[1])
    light = gains * STUDIO.shade(normals, seen.T)
    own = (decoder.shares @ who.albedo) * who.detail[decoder.density][:, None]
    linear = np.minimum(own, 1) ** 2 * (surface.interpolate @ light)
    expected = developed(linear)
    decoder.wrinkles.fold(code @ decoder.coding.to_rig, expected, who.wrinkles)
    rims = SHEEN * (decoder.shares @ who.gloss) * (surface.interpolate @ seen[2])
    np.testing.assert_allclose(cloud.shine.weights[:, 2], rims, atol=1e-4)
    bare = surface.share_on(np.concatenate(decoder.eyeballs)) == 0
    # lids colour what they cover: test_cover.py
    bare[np.concatenate([eye.covered for eye in decoder.eyes])] = False
    np.testing.assert_allclose(cloud.colors[: len(expected)][bare], expected[bare], atol=1e-4)


def test_neighbours_stand_together(decoder):
    """What the loops read is near what they read just before."""
    first = decoder.surface.interpolate.indices.reshape(-1, 3).min(1)
    assert (np.diff(first) >= 0).all()


@pytest.mark.parametrize("name", ["ada", "ines"])
def test_lips_that_roll_in_keep_light(decoder, name):
    """Dark blots on them would look like drops."""
    who, lips = identity.load(name), np.isin(decoder.surface.used, decoder.regions["lips"])
    seen = decoder.visibility(sheet.code(decoder, sheet.SPEECH["f"][0]), who)[:2, lips]
    assert (seen >= 0.55 * who.visibility[:2, lips] - 1e-6).all()


@pytest.mark.parametrize("head", [REST, HeadPose((2.0, 1.0, 3.0), (0.98, 0.05, 0.18, 0.03))])
def test_any_number_of_threads_makes_the_same_face(decoder, monkeypatch, head):
    who, code = identity.load("ines"), sheet.code(decoder, {"jawOpen": 0.4, "browDown_L": 0.7})
    made = []
    for count in (1, 2, 3):
        monkeypatch.setattr(decoder._threads, "count", count)
        mesh, cloud = decoder.decode(code, sheet.gaze(5, 9), who, head, 0.4)
        rows = [getattr(cloud, name) for name in FIELDS]
        made.append([array.tobytes() for array in (mesh.vertices, cloud.shine.weights, *rows)])
    assert made[0] == made[1] == made[2]
