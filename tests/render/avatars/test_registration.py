"""Scans of another topology: how near they come, and what is refused."""

import json
import struct
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from render.avatars import alignment, detail, registration, scan_texture, surface_scan, textures
from render.avatars.maker import Maker
from render.avatars.surface_scan import Scan
from render.decoder import identity, mesh_parts
from render.decoder.learned import avatar_files
from render.gl.contexts import GLContext
from render.types import AHEAD
from sensors.types import InputError

pytestmark = pytest.mark.slow

NOWHERE = np.zeros((0, 3))
TURN = Rotation.from_euler("xyz", (80, 12, -9), degrees=True).as_matrix()  # z up, and askew
RED, PALE = (0.8, 0.2, 0.2), (0.9, 0.8, 0.7)


@pytest.fixture(scope="module")
def maker(egl_context: GLContext) -> Maker:
    return Maker(context=egl_context)


@pytest.fixture(scope="module")
def scan_file(maker: Maker, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Joao's skin and eyes, finer, in another order, turned, in metres, with red lips and noise."""
    truth = identity.load("joao").geometry.astype(np.float64)
    kinds = maker.surface_kinds[maker.solid]
    kept = maker.solid[(kinds <= mesh_parts.EYE).all(1)]
    colors = np.tile(PALE, (len(truth), 1))
    colors[maker.regions["lips"]] = RED
    both, faces = trimesh.remesh.subdivide(np.hstack([truth, colors]), kept)
    rng = np.random.default_rng(0)
    order = rng.permutation(len(both))
    places, colors = both[order, :3] + rng.normal(0, 0.3, (len(both), 3)), both[order, 3:]
    places = (places @ TURN.T + (40, -300, 90)) / 1000
    mesh = trimesh.Trimesh(
        places, np.argsort(order)[faces], vertex_colors=(255 * colors).astype("u1"), process=False
    )
    path = tmp_path_factory.mktemp("scan") / "head.ply"
    mesh.export(path)
    return path


@pytest.fixture(scope="module")
def fit(maker: Maker, scan_file: Path) -> registration.Fit:
    """With the scanned person left out of those who are known."""
    others = [name for name in avatar_files.shipped() if name != "joao"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(avatar_files, "shipped", lambda: others)
        scan = surface_scan.read(scan_file, NOWHERE)
        assert scan.unit == "m"
        return registration.register(maker, scan, {}, lambda stage, done: None)


def test_a_scan_is_found_and_fitted(maker: Maker, fit: registration.Fit) -> None:
    truth = identity.load("joao").geometry.astype(np.float64)
    face, _ = registration.visible(maker)
    rigid = alignment.similarity(fit.geometry[face].astype(np.float64), truth[face], scaled=False)
    assert Rotation.from_matrix(rigid.rotation).magnitude() < np.radians(6)  # upright again
    made = rigid.place(fit.geometry.astype(np.float64))
    surface = trimesh.Trimesh(truth, maker.skin, process=False).sample(300_000)
    away, _ = KDTree(surface).query(made[face])
    assert np.median(away) < 0.6 and np.percentile(away, 95) < 1.8
    assert np.median(np.linalg.norm(made - truth, axis=1)[maker.regions["eyelids"]]) < 2.5


def test_its_lids_and_lips_close(maker: Maker, fit: registration.Fit) -> None:
    posing = maker.posing
    rest = posing.rest(fit.geometry)
    shut = posing.pose(posing.full_blink(), AHEAD, rest)
    assert posing.mouth.gaps(rest.geometry).max() < 0.2
    for line in posing.lid_lines:
        assert line.gaps(shut).max() < 0.3
        assert 7 < line.gaps(rest.geometry).max() < 15


def test_its_colours_become_the_atlas(maker: Maker, fit: registration.Fit) -> None:
    skin = scan_texture.paint(maker, fit.geometry, fit.scan)
    assert skin.shape == (1024, 2048, 3)
    on_skin = maker.anchor_kinds == mesh_parts.SKIN
    at = maker.surface.share_on(maker.regions["lips"])[on_skin]
    green = textures.sample(skin, maker.anchor_uv[on_skin] * detail.ATLAS)[:, 1]
    assert np.median(green[at > 0.9]) < 0.5 < np.median(green[at == 0])


def test_landmarks_tell_the_size_of_any_scan(
    maker: Maker, scan_file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(registration, "ROUNDS_EACH", 1)  # how near the skin comes is tested above
    truth = identity.load("joao").geometry.astype(np.float64)
    scan = surface_scan.read(scan_file, NOWHERE)
    odd = 0.37  # of a unit that nobody uses
    scan = Scan(scan.points * odd, scan.normals, scan.places * odd, scan.colors, "mm")
    marks = {
        name: (truth[vertex] @ TURN.T + (40, -300, 90)) * odd
        for name, vertex in registration.landmark_vertices(maker).items()
    }
    fit = registration.register(maker, scan, marks, lambda stage, done: None)
    for name in ("mouth_left", "left_eye_outer", "nose_tip"):
        vertex = registration.landmark_vertices(maker)[name]
        near = alignment.similarity(fit.scan.points, scan.points / odd, scaled=False)
        there = near.place(fit.geometry[vertex].astype(np.float64)[None])[0]
        assert np.linalg.norm(there - marks[name] / odd) < 4


def test_what_is_no_face_is_refused(maker: Maker, tmp_path: Path) -> None:
    box = trimesh.creation.box((200, 300, 220)).subdivide_to_size(20)
    box.export(tmp_path / "box.stl")
    scan = surface_scan.read(tmp_path / "box.stl", NOWHERE)
    with pytest.raises(InputError, match="expected a face, .* --landmarks FILE"):
        registration.register(maker, scan, {}, lambda stage, done: None)


def glb(tree: object) -> bytes:
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    start = struct.pack("<4sII", b"glTF", 2, 20 + len(text))
    return start + struct.pack("<I4s", len(text), b"JSON") + text


HUGE = {"accessors": [{"count": 10**12, "componentType": 5126, "type": "VEC3"}]}
PLY = b"ply\nformat binary_little_endian 1.0\nelement vertex 999999999\nproperty float x\n"


def ascii_ply(face: bytes, last: bytes) -> bytes:
    return (
        b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
        b"property float z\nelement face 501\nproperty list uchar int vertex_indices\nend_header\n"
        b"0 0 0\n1 0 0\n0 1 0\n" + face * 500 + last
    )


@pytest.mark.parametrize(
    ("name", "data", "words"),
    [
        ("a.glb", glb(HUGE), "accessors without data"),
        ("a.glb", b"no", "no GLB"),
        ("a.ply", PLY + b"end_header\n", "counts beyond its size"),
        ("a.ply", b"ply\nformat ascii 1.0\nend_header\n", "expected a mesh"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "triangles, got 1"),
        ("a.ply", ascii_ply(b"3 0 1 2\n", b"3 0 1 9\n"), "triangles of its 3 vertices"),
        ("a.obj", b"v 0\nv 1\nv 0\n" + b"f 1 2 3\n" * 500, "got other shapes"),
        ("a.stl", b"solid x", "expected a mesh"),
        ("a.fbx", b"x", "expected .obj, .ply, .glb, .stl"),
    ],
)
def test_what_is_no_scan_is_refused(name: str, data: bytes, words: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(data)
    with pytest.raises(InputError, match=words):
        surface_scan.read(tmp_path / name, NOWHERE)


def test_an_odd_size_and_a_missing_extra_name_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "ball.ply"
    trimesh.creation.icosphere(subdivisions=3, radius=3.7).export(path)
    with pytest.raises(InputError, match="scale it to millimetres, or mark the face"):
        surface_scan.read(path, NOWHERE)
    monkeypatch.setitem(sys.modules, "trimesh", None)
    with pytest.raises(InputError, match=r"pip install 'livedrive\[register\]'"):
        surface_scan.read(path, NOWHERE)


def test_an_obj_opens_textures_of_its_own_folder_alone(tmp_path: Path) -> None:
    """What a material names elsewhere, or by a link, is not followed."""
    inside = tmp_path / "scan"
    inside.mkdir()
    ball = trimesh.creation.icosphere(subdivisions=3, radius=100)
    uv = np.full((len(ball.vertices), 2), 0.5)
    ball.visual = trimesh.visual.TextureVisuals(uv, image=Image.new("RGB", (8, 8), (51, 204, 51)))
    ball.export(inside / "ball.obj", mtl_name="ball.mtl")
    (picture,) = inside.glob("*.png")
    colors = surface_scan.read(inside / "ball.obj", NOWHERE).colors
    assert colors is not None
    np.testing.assert_allclose(colors[0], (0.2, 0.8, 0.2))
    picture.rename(tmp_path / picture.name)
    material = (inside / "ball.mtl").read_text()
    (inside / "ball.mtl").write_text(material.replace(picture.name, f"../{picture.name}"))
    assert surface_scan.read(inside / "ball.obj", NOWHERE).colors is None
    (inside / "ball.mtl").write_text(material)
    picture.symlink_to(tmp_path / picture.name)
    assert surface_scan.read(inside / "ball.obj", NOWHERE).colors is None
