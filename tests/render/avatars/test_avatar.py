"""New people: what `avatar create` accepts, refuses and repairs; PLY files; borrowed hair."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from quick_colors import quick_colors

from render.avatars import maker as avatar
from render.avatars import ply, scan, sheet
from render.avatars.hair_transfer import transfer, worn
from render.decoder import identity
from render.decoder.decoder import Decoder
from render.decoder.identity import Identity
from render.decoder.learned import avatar_files
from render.gl.contexts import GLContext
from render.splats.shine import colors_from
from render.types import FIELDS, Gaussians
from sensors.types import InputError

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def maker(egl_context: GLContext) -> Iterator[avatar.Maker]:
    with quick_colors():
        yield avatar.Maker(context=egl_context)


@pytest.fixture(scope="module")
def skin() -> np.ndarray:
    """A skin with a light face and a dark back of the head."""
    out = np.empty((1024, 2048, 3), np.float32)
    out[:, :1024], out[:, 1024:] = (0.8, 0.6, 0.5), (0.4, 0.3, 0.25)
    return out


@pytest.fixture(scope="module")
def geometry() -> np.ndarray:
    return identity.load("kofi").geometry * np.float32(1.03)


@pytest.fixture(scope="module")
def bald(maker: avatar.Maker, geometry: np.ndarray, skin: np.ndarray) -> Identity:
    """A larger Kofi with blue eyes in that skin."""
    return maker.identity("new", geometry, skin, "blue")


def test_a_new_person_keeps_their_shape_and_takes_their_texture(maker, geometry, bald):
    assert np.abs(bald.geometry - geometry).max() < 2.0  # the lips alone are sealed
    assert np.linalg.norm(bald.geometry - geometry, axis=1).mean() < 0.02
    face = maker.surface.used[maker.surface.interpolate.indices[::3]] < 6000
    np.testing.assert_allclose(np.median(bald.albedo[face], 0), (0.8, 0.6, 0.5), atol=0.03)
    decoder = Decoder.load()
    cloud = sheet.posed(decoder, bald, "smile")
    cloud.check()
    assert all(np.isfinite(getattr(cloud, name)).all() for name in FIELDS)


def test_a_tongue_is_redder_than_the_prior_knows_and_lower_teeth_darker(maker, skin):
    used, gains = maker.surface.used, maker.mouth_tints
    tongue = np.isin(used, maker.posing.tongue)
    assert (gains[tongue, 0] > gains[tongue, 1]).all() and (gains[used < 10_000] == 1).all()
    lower = np.flatnonzero((gains < 1).all(1))
    highest = maker.template[maker.posing.mouth.lower, 1].max()
    assert len(lower) > 100 and (maker.template[used[lower], 1] < highest).all()
    on_tongue = maker.surface.share_on(maker.posing.tongue) > 0.99
    red, green, _ = maker.albedo(skin, "brown")[on_tongue].T
    assert np.median(red / green) > 1.5  # 1.46 without


def test_every_bust_ends_in_a_fade(maker, bald):
    """Red before: only those that are shipped did; one made from a scan had a torn edge."""
    head = maker.surface
    heights = head.interpolate @ maker.template[head.used, 1]
    for who in (bald, *map(identity.load, avatar_files.shipped())):
        shown = who.opacity_factors
        assert shown[heights < -188].max() < 0.2 and (shown[heights < -188] > 0).any()
        assert 0.3 < shown[(heights > -182) & (heights < -178)].mean() < 0.7
        assert np.median(shown[heights > -165]) == 1


def test_an_identity_survives_its_file(bald, tmp_path):
    lender = identity.load("ada")
    who = replace(bald, hair=transfer(lender, bald))
    identity.save(who, tmp_path, {"command": "test"})
    again = identity.load("new", tmp_path)
    assert np.abs(again.geometry - who.geometry).max() <= 0.5 / 128 + 1e-5
    assert np.abs(again.albedo - who.albedo).max() <= 0.5 / 255 + 1e-6
    assert np.abs(again.hair.means - who.hair.means).max() < 0.2
    for a, b in zip(again.biases, who.biases, strict=True):
        np.testing.assert_allclose(a, b, atol=2e-3, rtol=2e-3)


def test_borrowed_hair_follows_the_head():
    lender = identity.load("ada")
    wider = replace(lender.rest, geometry=lender.geometry * np.float32([1.1, 1, 1]))
    moved = transfer(lender, replace(lender, rest=wider))
    hair = lender.hair.means
    side = hair[:, 0] > 60
    assert np.median(moved.means[side, 0] - hair[side, 0]) > 4
    assert np.abs(moved.means[:, 1] - hair[:, 1]).max() < 1


def test_skin_under_borrowed_hair_has_its_roots(maker, bald):
    """Red before: a fair scalp shone through dark hair."""
    lender = identity.load("chen")
    who = worn(maker, bald, lender)
    points = maker.surface.interpolate @ maker.template[maker.surface.used]
    crown, chin = points[:, 1] > 120, np.abs(points - (0, -75, 75)).max(1) < 15
    np.testing.assert_allclose(who.albedo[chin], bald.albedo[chin])
    dark = lender.albedo[crown].mean()
    assert abs(who.albedo[crown].mean() - dark) < 0.3 * abs(bald.albedo[crown].mean() - dark)
    assert worn(maker, bald, identity.load("hugo")) is bald


def test_thin_hair_has_roots_too(maker, bald):
    """Red before: cropped hair on a large head lay nowhere densely, which was an IndexError."""
    lender = identity.load("joao")
    thin = lender.hair.rows(slice(None, None, 4))
    who = worn(maker, bald, replace(lender, hair=thin))
    points = maker.surface.interpolate @ maker.template[maker.surface.used]
    crown = points[:, 1] > 120
    assert np.isfinite(who.albedo).all()
    assert who.albedo[crown].mean() < bald.albedo[crown].mean() - 0.01


@pytest.mark.parametrize(("count", "rows", "columns"), [(1, 1, 1), (3, 1, 3), (4, 2, 3), (6, 2, 3)])
def test_a_sheet_is_as_wide_as_its_pictures(count, rows, columns):
    """Red before: a portrait stood beside two blank squares."""
    pictures = [np.full((4, 5, 3), 10 + k, np.uint8) for k in range(count)]
    whole = sheet.grid(pictures, 3)
    assert whole.shape == (4 * rows, 5 * columns, 3)
    cells = whole[::4, ::5, 0].ravel().tolist()
    assert cells == [10 + k for k in range(count)] + [10] * (rows * columns - count)


def damaged(change: str) -> np.ndarray:
    vertices = identity.load("ben").geometry.copy()
    if change == "nan":
        vertices[100:140] = np.nan
    elif change == "few":
        vertices = vertices[:-1]
    elif change == "holes":
        vertices[:4000] = vertices[0]
    elif change == "tiny":
        vertices *= 1e-5
    elif change == "huge":
        vertices *= 40
    return vertices


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("nan", r"expected finite coordinates, got 40 vertices"),
        ("few", r"expected vertices \[26719, 3\] .* got shape \[26718, 3\]"),
        ("holes", r"expected a surface without holes"),
        ("tiny", r"expected a head and neck"),
        ("huge", r"expected a head and neck"),
    ],
)
def test_bad_geometry_is_refused(maker, change, words, tmp_path: Path):
    path = tmp_path / "g.npz"
    np.savez(path, vertices=damaged(change))
    with pytest.raises(InputError, match=words):
        scan.read_geometry(path, maker.faces)


@pytest.mark.parametrize("factor", [0.1, 0.001])
def test_centimetres_and_metres_become_millimetres(maker, factor):
    geometry = identity.load("ben").geometry
    scaled = scan.check_geometry(geometry * np.float32(factor), maker.faces, "g")
    np.testing.assert_allclose(scaled, geometry, atol=1e-3)


def test_an_obj_keeps_the_order_of_its_vertices(maker, tmp_path: Path):
    geometry, path = identity.load("ben").geometry, tmp_path / "head.OBJ"
    rows = [f"v {x / 10} {y / 10} {z / 10} 0.5 0.5 0.5" for x, y, z in geometry.tolist()]
    path.write_text("\n".join(["# in centimetres", *rows, "vt 0 0", "f 1/1 2/1 3/1"]))
    np.testing.assert_allclose(scan.read_geometry(path, maker.faces), geometry, atol=1e-3)
    path.write_text("v 1 2 x")
    with pytest.raises(InputError, match="expected lines 'v x y z'"):
        scan.read_geometry(path, maker.faces)
    path.write_text("v 1 2 3")
    with pytest.raises(InputError, match=r"expected vertices \[26719, 3\]"):
        scan.read_geometry(path, maker.faces)


def test_files_that_are_no_geometry_are_refused(maker, tmp_path: Path):
    path = tmp_path / "g.npz"
    path.write_bytes(b"no zip")
    with pytest.raises(InputError, match="expected an npz or OBJ file, got another kind of file"):
        scan.read_geometry(path, maker.faces)
    np.savez(path, points=np.zeros(3))
    with pytest.raises(InputError, match="expected an array 'vertices', got points"):
        scan.read_geometry(path, maker.faces)


def test_geometry_of_another_kind_is_told(maker, tmp_path: Path) -> None:
    """Red before: of an FBX that it needs a --texture; of words in an array a traceback."""
    with pytest.raises(InputError, match=r"head.fbx: expected one of .*\.npz, got '.fbx'; export"):
        scan.is_registered(tmp_path / "head.fbx", maker.faces)
    np.savez(tmp_path / "g.npz", vertices=np.full((26719, 3), "x"))
    with pytest.raises(InputError, match=r"g.npz: expected numbers, got <U1; save them"):
        scan.read_geometry(tmp_path / "g.npz", maker.faces)


def test_textures_are_resized_or_refused(tmp_path: Path):
    path = tmp_path / "t.png"
    Image.new("RGB", (1024, 512), (200, 150, 120)).save(path)
    assert scan.read_texture(path).shape == (1024, 2048, 3)
    Image.new("RGB", (1024, 1024)).save(path)
    with pytest.raises(InputError, match=r"expected 2048 x 1024 .* got 1024 x 1024"):
        scan.read_texture(path)
    Image.new("RGBA", (1024, 512), (200, 150, 120, 255)).save(path)
    assert scan.read_texture(path).shape == (1024, 2048, 3)  # opaque alpha says nothing
    Image.new("RGBA", (1024, 512), (200, 150, 120, 90)).save(path)
    with pytest.raises(InputError, match="expected an opaque texture"):
        scan.read_texture(path)
    path.write_bytes(b"no picture")
    with pytest.raises(InputError, match="expected a picture"):
        scan.read_texture(path)


def test_a_texture_is_read_as_photographs_are(tmp_path: Path):
    """Red before: a traceback's words without a name, 16 bits all white, holes of a palette."""
    levels = np.linspace(0, 65535, 256 * 512).reshape(256, 512).astype(np.uint16)
    Image.fromarray(levels).save(tmp_path / "deep.png")
    assert 0.45 < scan.read_texture(tmp_path / "deep.png").mean() < 0.55
    holes = Image.new("RGB", (512, 256), (200, 150, 120)).quantize(4)
    holes.save(tmp_path / "holes.png", transparency=0)
    with pytest.raises(InputError, match="expected an opaque texture"):
        scan.read_texture(tmp_path / "holes.png")
    data = (tmp_path / "deep.png").read_bytes()
    (tmp_path / "cut.png").write_bytes(data[: len(data) // 2])
    with pytest.raises(InputError, match=r"cut.png: .* got one that is cut off; copy it again"):
        scan.read_texture(tmp_path / "cut.png")
    (tmp_path / "link.png").symlink_to(tmp_path / "deep.png")
    with pytest.raises(InputError, match="got a link"):
        scan.read_texture(tmp_path / "link.png")


def test_an_unknown_eye_names_the_others(maker, skin):
    with pytest.raises(InputError, match="expected one of blue, brown, brownlight, green, grey"):
        maker.albedo(skin, "violet")


def test_a_sheet_of_any_number_of_pictures_ends_in_background() -> None:
    """Red before: `avatar show all --sheet portrait` ended in a traceback where somebody had an
    avatar of their own: thirteen are no rows of six."""
    pictures = [np.full((2, 3, 4), value, np.uint8) for value in range(7)]
    pictures[0][1:] = 200  # somebody before the background
    drawn = sheet.grid(pictures, 6)
    assert drawn.shape == (4, 18, 4)
    assert (drawn[2:, :3] == 6).all()
    assert not drawn[2:, 3:].any()


def test_a_head_survives_ply(tmp_path: Path):
    cloud = sheet.posed(Decoder.load(), identity.load("ben"), "jaw open")
    ply.save(tmp_path / "head.ply", cloud)
    again = ply.load(tmp_path / "head.ply")
    np.testing.assert_allclose(again.means, cloud.means, atol=1e-4)
    np.testing.assert_allclose(again.scales, cloud.scales, rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(again.colors, colors_from(cloud), atol=1e-5)  # of a viewer ahead
    np.testing.assert_allclose(again.opacities, cloud.opacities, atol=2e-4)
    turned = np.abs((again.quats * cloud.quats).sum(1)) / np.linalg.norm(cloud.quats, axis=1)
    np.testing.assert_allclose(turned, 1, atol=1e-5)


def test_a_foreign_ply_is_scaled_and_a_broken_one_refused(tmp_path: Path):
    cloud = sheet.posed(Decoder.load(), identity.load("ben"), "neutral")
    metres = Gaussians(
        cloud.means / 1000, cloud.quats, cloud.scales / 1000, cloud.opacities, cloud.colors
    )
    ply.save(tmp_path / "head.ply", metres)
    size = np.ptp(np.percentile(ply.load(tmp_path / "head.ply").means, (2, 98), axis=0), 0).max()
    assert 250 < size < 350
    data = (tmp_path / "head.ply").read_bytes()
    (tmp_path / "head.ply").write_bytes(data[:-1000])
    with pytest.raises(InputError, match="got a truncated"):
        ply.load(tmp_path / "head.ply")
    (tmp_path / "head.ply").write_text("ply\nformat ascii 1.0\nend_header\n")
    with pytest.raises(InputError, match="expected a PLY file, format binary_little_endian"):
        ply.load(tmp_path / "head.ply")
    words = "ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty float x\n"
    (tmp_path / "head.ply").write_bytes(words.encode() + b"end_header\n" + bytes(4))
    with pytest.raises(InputError, match="expected Gaussian splats with a property 'y'"):
        ply.load(tmp_path / "head.ply")
    (tmp_path / "head.ply").write_bytes(words.encode() + b"end_header")  # red before: a traceback
    with pytest.raises(InputError, match="expected a PLY file, format binary_little_endian"):
        ply.load(tmp_path / "head.ply")
    (tmp_path / "link.ply").symlink_to(tmp_path / "head.ply")
    with pytest.raises(InputError, match="got a link"):  # red before: it was followed
        ply.load(tmp_path / "link.ply")
