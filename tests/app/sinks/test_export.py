"""Files for other programs, each opened by a reader that is not ours."""

import csv
import shutil
from pathlib import Path
from types import SimpleNamespace

import av
import numpy as np
import pygltflib
import pytest
from plyfile import PlyData
from pylivelinkface import FaceBlendShape

from app.drive.sink import FrameResult, RunInfo
from app.sinks.arkit import ArkitSink
from app.sinks.clouds import CloudSink
from encoder.types import DrivenFrame
from render.avatars import gltf, ply, sheet
from render.avatars.gltf import EXTENSION, SH_0
from render.decoder import identity
from render.decoder.decoder import Decoder
from render.types import AHEAD, Gaussians
from sensors.session.export import export
from sensors.types import FPS, NS, InputError, SensorFrame

SMOKE = Path(__file__).parents[3] / "recordings" / "smoke"
COUNT = 200


@pytest.fixture
def cloud() -> Gaussians:
    rng = np.random.default_rng(5)
    return Gaussians(
        means=rng.uniform(-150, 150, (COUNT, 3)).astype(np.float32),
        quats=rng.standard_normal((COUNT, 4)).astype(np.float32),
        scales=rng.uniform(0.1, 6, (COUNT, 3)).astype(np.float32),
        opacities=rng.uniform(0.05, 0.95, COUNT).astype(np.float32),
        colors=rng.uniform(0, 1, (COUNT, 3)).astype(np.float32),
    )


def unit(quats: np.ndarray) -> np.ndarray:
    return quats / np.linalg.norm(quats, axis=1, keepdims=True)


def results(count: int) -> list[FrameResult]:
    made: list[FrameResult] = []
    for index in range(count):
        t_ns = (index + 1) * NS // FPS
        silence, ages = np.zeros(1600, np.float32), np.full(2, -1, np.int64)
        frame = SensorFrame(index, t_ns, silence, None, np.zeros(2, bool), ages, False)
        code = np.full(256, 0.02 * index, np.float32)
        made.append(FrameResult(frame, DrivenFrame(index, t_ns, code, AHEAD), None))
    return made


def test_plyfile_reads_a_head(cloud: Gaussians, tmp_path: Path) -> None:
    path = tmp_path / "head.ply"
    ply.save(path, cloud)
    vertex = PlyData.read(str(path))["vertex"]

    def columns(*names: str) -> np.ndarray:
        return np.stack([vertex[name] for name in names], 1)

    np.testing.assert_allclose(columns("x", "y", "z"), cloud.means, rtol=1e-5)
    scales = np.exp(columns("scale_0", "scale_1", "scale_2"))
    np.testing.assert_allclose(scales, cloud.scales, rtol=1e-5)
    turns = unit(columns("rot_0", "rot_1", "rot_2", "rot_3"))
    np.testing.assert_allclose(turns, unit(cloud.quats), atol=1e-6)
    colors = 0.5 + SH_0 * columns("f_dc_0", "f_dc_1", "f_dc_2")
    np.testing.assert_allclose(colors, cloud.colors, atol=1e-6)
    opacities = 1 / (1 + np.exp(-vertex["opacity"]))
    np.testing.assert_allclose(opacities, cloud.opacities, atol=1e-6)


def test_pygltflib_reads_a_posed_head(cloud: Gaussians, tmp_path: Path) -> None:
    path = tmp_path / "head.glb"
    gltf.save(path, cloud)
    file = pygltflib.GLTF2().load(str(path))
    assert file is not None and file.extensionsUsed == [EXTENSION]
    primitive = file.meshes[0].primitives[0]
    assert primitive.mode == pygltflib.POINTS
    assert primitive.extensions[EXTENSION]["colorSpace"] == "srgb_rec709_display"

    def values(name: str) -> np.ndarray:
        accessor = file.accessors[getattr(primitive.attributes, name)]
        view = file.bufferViews[accessor.bufferView]
        width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor.type]
        kind = np.uint8 if accessor.componentType == pygltflib.UNSIGNED_BYTE else np.float32
        count = accessor.count * width
        return np.frombuffer(file.binary_blob(), kind, count, view.byteOffset).reshape(-1, width)

    np.testing.assert_allclose(values("POSITION"), cloud.means / 1000, rtol=1e-6)
    np.testing.assert_allclose(values(f"{EXTENSION}:SCALE"), cloud.scales / 1000, rtol=1e-6)
    turns = values(f"{EXTENSION}:ROTATION")
    np.testing.assert_allclose(turns[:, [3, 0, 1, 2]], unit(cloud.quats), atol=1e-6)
    np.testing.assert_allclose(values(f"{EXTENSION}:OPACITY")[:, 0], cloud.opacities, rtol=1e-6)
    shown = 0.5 + SH_0 * values(f"{EXTENSION}:SH_DEGREE_0_COEF_0")
    np.testing.assert_allclose(shown, cloud.colors, atol=1e-6)
    assert values("COLOR_0").shape == (COUNT, 4)
    assert {view.target for view in file.bufferViews} == {pygltflib.ARRAY_BUFFER}
    position = file.accessors[primitive.attributes.POSITION]
    assert position.min == pytest.approx((cloud.means / 1000).min(0), abs=1e-6)
    assert position.max == pytest.approx((cloud.means / 1000).max(0), abs=1e-6)


def test_what_a_head_mirrors_is_in_both_kinds_of_files(tmp_path: Path) -> None:
    """Red before: glTF had matt skin and eyes without a light in them."""
    cloud = sheet.posed(Decoder.load(gaussians="16k"), identity.load("ben"), "neutral")
    assert cloud.shine is not None
    ply.save(tmp_path / "head.ply", cloud)
    vertex = PlyData.read(str(tmp_path / "head.ply"))["vertex"]
    gltf.save(tmp_path / "head.glb", cloud)
    file = pygltflib.GLTF2().load(str(tmp_path / "head.glb"))
    assert file is not None
    attributes = file.meshes[0].primitives[0].attributes

    def values(name: str, kind: type[np.generic], width: int) -> np.ndarray:
        view = file.bufferViews[file.accessors[getattr(attributes, name)].bufferView]
        data = np.frombuffer(file.binary_blob(), kind, width * len(cloud), view.byteOffset)
        return data.reshape(-1, width).astype(float)

    shown = np.stack([vertex[f"f_dc_{k}"] for k in range(3)], 1)
    stored = values(f"{EXTENSION}:SH_DEGREE_0_COEF_0", np.float32, 3)
    np.testing.assert_allclose(stored, shown, atol=1e-5)
    srgb = (0.5 + SH_0 * shown).clip(0, 1)
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(values("COLOR_0", np.uint8, 4)[:, :3] / 255, linear, atol=0.003)


@pytest.mark.slow
def test_much_is_told_before_it_is_written_and_too_much_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Red before: 2 GB for the demo without a word."""
    decoder, who = Decoder.load(), identity.load("ben")
    sink = CloudSink(tmp_path / "heads", 1, ".ply", ply.save, decoder, who)
    sink.on_start(RunInfo(64, 64, 484))
    told = capsys.readouterr().err
    assert "484 files" in told and " GB; --every" in told
    assert not list((tmp_path / "heads").iterdir())
    CloudSink(tmp_path / "heads", 30, ".ply", ply.save, decoder, who).on_start(RunInfo(64, 64, 484))
    assert capsys.readouterr().err == ""
    full = SimpleNamespace(free=1_000_000)
    monkeypatch.setattr(shutil, "disk_usage", lambda path: full)
    with pytest.raises(InputError, match="try --every 30"):
        sink.on_start(RunInfo(64, 64, 484))


def test_a_full_disk_is_told_with_the_folder(tmp_path: Path) -> None:
    """Red before: with a spare file of a folder that was gone."""
    decoder, who = Decoder.load(), identity.load("ben")

    def save(path: Path, _: Gaussians) -> None:
        raise OSError(28, "No space left on device", str(path))

    sink = CloudSink(tmp_path, 1, ".ply", save, decoder, who)
    with pytest.raises(OSError) as told:
        sink.on_start(RunInfo(64, 64, 90))
    assert told.value.filename == str(tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize(("suffix", "save"), [(".ply", ply.save), (".glb", gltf.save)])
def test_the_moving_head_is_a_folder_of_files(
    tmp_path: Path,
    suffix: str,
    save,  # noqa: ANN001
) -> None:
    sink = CloudSink(tmp_path / "x", 3, suffix, save, Decoder.load(), identity.load("ben"))
    sink.on_start(RunInfo(64, 64, 7))
    for result in results(7):
        sink.on_frame(result)
    sink.close()
    files = sorted((tmp_path / "x").iterdir())
    assert [f.name for f in files] == [f"frame_{k:06d}{suffix}" for k in (0, 3, 6)]
    assert len({f.read_bytes() for f in files}) == 3
    with pytest.raises(InputError):
        CloudSink(tmp_path / "x", 0, suffix, save, Decoder.load(), identity.load("ben"))


@pytest.mark.slow
def test_the_live_link_table_has_the_names_of_a_live_link_reader(tmp_path: Path) -> None:
    sink = ArkitSink(tmp_path / "face.csv", Decoder.load())
    sink.on_start(RunInfo(64, 64, 3))
    for result in results(3):
        sink.on_frame(result)
    sink.close()
    with (tmp_path / "face.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 3
    assert {shape.name for shape in FaceBlendShape} <= set(rows[0])
    assert all(float(row[shape.name]) <= 1 for row in rows for shape in FaceBlendShape)


@pytest.mark.slow
def test_a_session_becomes_one_video_that_pyav_plays(tmp_path: Path) -> None:
    export(SMOKE, tmp_path / "smoke.mkv")
    with av.open(str(tmp_path / "smoke.mkv")) as file:
        assert [s.type for s in file.streams] == ["video", "audio"]
        pictures = sum(1 for _ in file.decode(video=0))
    with av.open(str(tmp_path / "smoke.mkv")) as file:
        samples = sum(block.samples for block in file.decode(audio=0))
    assert (pictures, samples) == (90, 90 * 1600)
