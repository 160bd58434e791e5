"""Shut lids hide the eyes, and eyes seen near have no holes."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import binary_erosion, maximum_filter
from scipy.spatial import KDTree

from render import cameras
from render.avatars import sheet
from render.decoder import identity, prior_file
from render.decoder import lines as contact
from render.decoder.cover import spacing
from render.decoder.decoder import Decoder
from render.decoder.eyes import bared
from render.decoder.learned import avatar_files, weights_file
from render.types import AHEAD, Camera, Gaussians

SIZE_PX, SPAN_MM, DISTANCE_MM = 256, 40.0, 900.0


def near(who: identity.Identity, eye: int) -> Camera:
    """A camera that sees one eye only, five times larger than a portrait does."""
    x, y, z = (float(v) for v in who.eye_centers[eye])
    camera = cameras.portrait(SIZE_PX, SIZE_PX, target_mm=(x, y, z))
    K = camera.K.copy()
    K[0, 0] = K[1, 1] = SIZE_PX * DISTANCE_MM / SPAN_MM
    return replace(camera, K=K, background=(0.0, 0.0, 0.0))


def eyes(decoder: Decoder) -> np.ndarray:  # [N]
    return decoder.surface.share_on(np.concatenate(decoder.eyeballs)) > 0.99


def painted(decoder: Decoder, who: identity.Identity, pose: str, color: float) -> Gaussians:
    """The head without the eyes' highlights, its eyeballs in one colour."""
    cloud = sheet.posed(decoder, who, pose)
    count = len(decoder.surface.scales)
    cloud.opacities[count : count + 2] = 0
    cloud.colors[:count][eyes(decoder)] = color
    return cloud


@pytest.mark.parametrize("name", ["ada", "kofi"])
def test_a_shut_lid_hides_the_eye(decoder, tiles, name):
    who = identity.load(name)
    for eye in range(2):
        pictures = []
        for color in (0.0, 1.0):
            tiles.draw(painted(decoder, who, "blink", color), near(who, eye))
            pictures.append(tiles.read_rgba()[..., :3].astype(int))
        shines_through = np.abs(pictures[1] - pictures[0]).max(2) / 255
        assert np.quantile(shines_through, 0.99) < 0.22


def test_what_a_lid_covers_takes_its_colour(decoder):
    """A fifth of the eye shines through a shut lid: as skin."""
    who = identity.load("kofi")
    shut, opened = (sheet.posed(decoder, who, pose).colors for pose in ("blink", "neutral"))
    for of, line in zip(decoder.eyes, decoder.posing.lid_lines, strict=True):
        eye, lid = of.ball, shut[of.lid].mean(0)
        places = (decoder.surface.interpolate @ who.geometry[decoder.surface.used])[eye]
        shows = eye[line.between_sides(who.geometry, places) & (places[:, 2] > places[:, 2].mean())]
        assert np.ptp(opened[shows].mean(1)) > 0.4 and len(shows) > 200  # pupil and white
        assert np.median(np.abs(shut[shows] - lid)) < 0.03
        lining = np.setdiff1d(of.covered, of.ball)  # red before: black, and seen through the lid
        mesh, cloud = decoder.decode(sheet.code(decoder, sheet.BLINK), AHEAD, who)
        clear = [line.clearance(mesh.vertices, point) for point in cloud.means[lining]]
        deep = lining[np.array(clear) < -2]
        assert len(deep) > 20 and np.median(np.abs(shut[deep] - lid)) < 0.03


@pytest.mark.parametrize("yaw, pitch", [(0, 0), (-60, 0), (35, 0), (0, 20), (0, -20)])
def test_no_view_shows_skin_on_an_eye(decoder, tiles, monkeypatch, yaw, pitch):
    who, pictures = identity.load("kofi"), []
    camera = near(who, 1)
    turned = cameras.portrait(
        SIZE_PX, SIZE_PX, yaw, pitch, target_mm=tuple(who.eye_centers[1].tolist())
    )
    for edges in (contact.VEILED_MM, (np.float32(1e3), np.float32(2e3))):  # with and without
        monkeypatch.setattr(contact, "VEILED_MM", edges)
        for looking in (sheet.gaze(20, 0), sheet.gaze(-20, 10)):
            cloud = decoder.decode(sheet.code(decoder, {"eyeWide_R": 0.5}), looking, who)[1]
            tiles.draw(cloud, replace(camera, viewmat=turned.viewmat))
            pictures.append(tiles.read_rgba()[..., :3].astype(int))
    for veiled, bare in zip(pictures[:2], pictures[2:], strict=True):
        assert np.quantile(np.abs(veiled - bare).max(2), 0.995) < 40


def test_an_eye_seen_near_has_no_holes(decoder, tiles):
    who = identity.load("ben")
    cloud = painted(decoder, who, "neutral", 1.0)
    rows = np.flatnonzero(eyes(decoder))
    bare = Gaussians(
        cloud.means[rows], cloud.quats[rows], cloud.scales[rows],
        cloud.opacities[rows], cloud.colors[rows],
    )  # fmt: skip
    for eye in range(2):
        tiles.draw(bare, near(who, eye))
        # The middle of the picture is the iris and some white around it.
        middle = tiles.read_rgba()[96:160, 80:176, 0] / 255
        assert middle.min() > 0.7 and middle.mean() > 0.93


def test_ears_and_nape_have_no_holes(decoder, tiles):
    who = identity.load("hugo")
    cloud = sheet.posed(decoder, who, "neutral")
    off_face = np.flatnonzero(decoder.surface.share_on(decoder.regions["narrow_face"]) == 0)
    cloud.colors[:] = 0
    cloud.colors[off_face] = 1
    cloud.opacities[len(decoder.opacities) :] = 0  # strands, and those of the shirt's hem
    camera = replace(cameras.portrait(400, 400, yaw_deg=100), background=(0.0, 0.0, 0.0))
    tiles.draw(cloud, camera)
    picture = tiles.read_rgba()[..., 0] / 255
    tiles.draw(replace(cloud, scales=3 * cloud.scales), camera)
    inside = binary_erosion(tiles.read_rgba()[..., 0] > 250, iterations=16)
    assert inside.sum() > 20_000
    assert np.quantile(picture[inside], 0.01) > 0.65


@pytest.mark.parametrize("name", avatar_files.names())
def test_an_eye_that_turns_brings_out_no_darkness(decoder, name):
    """Light follows the expression, not the look: what lids hide at rest must be lit as well."""
    who = identity.load(name)
    for shows, hidden in bared(decoder.posing, who.geometry):
        arm = who.geometry[hidden] - who.geometry[[*shows, *hidden]].mean(0)
        near = hidden[arm[:, 2] > 0.75 * np.linalg.norm(arm, axis=1)]  # a look brings it out
        shown, covered = (np.isin(decoder.surface.used, v) for v in (shows, near))
        assert np.count_nonzero(covered) > 20 and who.visibility[:2, covered].min() > 0.6
        assert np.ptp(who.visibility[0, shown]) > 0.2  # what shows keeps the shadow of the lids


def test_no_expression_darkens_what_lids_hide(decoder):
    tensors, _ = weights_file.load(weights_file.FOLDER / "prior", prior_file.KIND)
    who, blink = identity.load("ben"), {"eyeBlink_L": 1.0, "eyeBlink_R": 1.0}
    seen = decoder.visibility(sheet.code(decoder, blink), who)
    for shows, hidden in bared(decoder.posing, prior_file.template(tensors)):
        shown, covered = (np.isin(decoder.surface.used, v) for v in (shows, hidden))
        np.testing.assert_allclose(seen[:, covered], who.visibility[:, covered], atol=1e-6)
        assert np.abs(seen[:, shown] - who.visibility[:, shown]).max() > 0.2


def test_the_pupil_shows_and_the_back_of_the_eye_does_not(decoder):
    who = identity.load("chen")
    for eye, (shows, hidden) in enumerate(bared(decoder.posing, who.geometry)):
        members = decoder.eyeballs[eye]
        front, back = (members[pick(who.geometry[members, 2])] for pick in (np.argmax, np.argmin))
        assert front in shows and back in hidden and len(shows) + len(hidden) == len(members)


def test_spacing_is_the_distance_to_the_neighbours():
    grid = np.stack(np.meshgrid(*[np.arange(5) * 2.0] * 2), -1).reshape(-1, 2)
    points = np.c_[grid, np.zeros(25)].astype(np.float32)
    assert spacing(points)[12] == pytest.approx(2.0)


def test_the_bust_ends_in_a_fade(decoder):
    """The lower edge of the mesh shows nothing; the neckline is covered."""
    cloud = sheet.posed(decoder, identity.load("ada"), "neutral")
    count = len(decoder.opacities)
    height, opacities = cloud.means[:count, 1], cloud.opacities[:count]
    low, neck = height < -181, np.abs(height + 130) < 5
    assert low.sum() > 2 and opacities[low].max() < 0.7
    assert np.median(opacities[neck]) > 0.9


def test_only_teeth_in_front_are_drawn(decoder):
    """From inside molars would be slivers: the fit never saw them so."""
    tensors, _ = weights_file.load(weights_file.FOLDER / "prior", prior_file.KIND)
    mesh, head = prior_file.template(tensors), decoder.surface
    rows = head.share_on(head.used[tensors["teeth_rows"]]) > 0.99
    points = head.interpolate @ mesh[head.used]
    for side, back in ((points[:, 1] < -34, 75), (points[:, 1] > -33, 73)):
        opacities, depth = decoder.opacities[rows & side], points[rows & side, 2]
        farthest = opacities[depth < back + 1]
        assert len(farthest) and farthest.max() < 0.1 and np.median(opacities[depth > 101]) > 0.5


def test_skin_of_a_thin_head_is_as_wide_as_the_holes_beside_it():
    """Blots on nape and scalp were gaps: the dark inside of a head."""
    t, card = weights_file.load(weights_file.FOLDER / "prior", prior_file.KIND)
    head = prior_file.parts(t, card, "32k")["surface"]
    mesh = prior_file.template(t)
    points = head.interpolate @ mesh[head.used]
    nape = np.flatnonzero((points[:, 2] < -30) & (points[:, 1] > -140) & (points[:, 1] < 110))
    corners = head.whole.corners[np.isin(head.whole.corners, head.used).all(1)]
    places = mesh[corners].mean(1)
    behind = (places[:, 2] < -50) & (places[:, 1] > -120) & (places[:, 1] < 90)
    distance, near = KDTree(points[nape]).query(places[behind])
    assert (distance < 1.15 * head.scales[nape][near]).mean() > 0.99


def seen_at(
    decoder: Decoder, tiles, who: identity.Identity, pose: dict[str, float], marked: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of anchors that face the viewer: places [n, 3] mm, and how much of what is seen around there
    is of the marked ones [n]; which anchors [n]."""
    code, count = sheet.code(decoder, pose), len(decoder.opacities)
    mesh, cloud = decoder.decode(code, AHEAD, who)
    cloud.colors[:] = 0
    cloud.colors[:count][marked] = 1
    cloud.opacities[count:] = 0
    camera = replace(cameras.portrait(1024, 1024), background=(0.0, 0.0, 0.0))
    tiles.draw(replace(cloud, shine=None), camera)
    normals = decoder.surface.interpolate @ decoder.surface.whole.normals(mesh.vertices)[0]
    rows = np.flatnonzero((normals[:, 2] > 0.5) & (decoder.surface.depths == 0))
    points = cloud.means[rows]
    at = (points @ camera.viewmat[:3, :3].T + camera.viewmat[:3, 3]) @ camera.K.T
    x, y = np.clip((at[:, :2] / at[:, 2:]).astype(int), 0, 1023).T
    return points, maximum_filter(tiles.read_rgba()[..., 0], 5)[y, x] / 255, rows


def test_no_mouth_comes_through_the_skin_below_a_lip(decoder, tiles):
    """Red before: as sand on a chin when the jaw opens."""
    inside = np.zeros(len(decoder.opacities), bool)
    inside[decoder.interior] = True
    who = identity.load("dalia")
    points, shown, rows = seen_at(decoder, tiles, who, {"jawOpen": 0.7}, inside)
    x, y, _ = points.T
    below = (np.abs(x) < 16) & (y > -84) & (y < -62) & ~inside[rows]
    assert below.sum() > 100 and np.quantile(shown[below], 0.98) < 0.06


def test_skin_beside_a_nose_has_no_cracks(tiles):
    """Red before: what faces away came through where no layer lies below, in a smile most."""
    dense, who = Decoder.load(gaussians="65k"), identity.load("lena")
    smile = sheet.POSES["smile"][0]
    normals = (
        dense.surface.interpolate
        @ dense.surface.whole.normals(dense.vertices(sheet.code(dense, smile), AHEAD, who))[0]
    )
    points, shown, _ = seen_at(dense, tiles, who, smile, normals[:, 2] < 0)
    x, y, _ = points.T
    beside = (np.abs(x) > 16) & (np.abs(x) < 26) & (y > -18) & (y < 4)
    assert beside.sum() > 100 and np.quantile(shown[beside], 0.98) < 0.08
