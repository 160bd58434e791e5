"""What the commands write, into a folder in which links wait: refused, and nothing is lost."""

import json
import shutil
import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import pytest

from app.drive.sink import FrameResult, RunInfo
from app.sinks.motion import save_npz
from app.sinks.pictures import PictureSink
from app.sinks.video import VideoSink, film
from app.web import certificate
from encoder.eyes.calibration import EyeCalibration
from encoder.eyes.gaze_graph import GazeGraph
from encoder.nn import checkpoint
from encoder.types import DrivenFrame
from render.avatars import gltf, ply
from render.decoder.learned import weights_file
from render.types import AHEAD, Gaussians
from sensors import files
from sensors.types import SensorFrame

MINE = b"precious"
ONE = Gaussians(
    means=np.zeros((1, 3), np.float32),
    quats=np.array([[1, 0, 0, 0]], np.float32),
    scales=np.ones((1, 3), np.float32),
    opacities=np.full(1, 0.5, np.float32),
    colors=np.full((1, 3), 0.5, np.float32),
)


def save_checkpoint(path: Path) -> None:
    import torch

    card = {"kind": "eyes", "config": {}}
    checkpoint.save(path.with_suffix(""), {"x": torch.zeros(1)}, card)


def save_weights(path: Path) -> None:
    weights_file.save(path.with_suffix(""), {"x": np.zeros(1)}, {"kind": "prior"})


def start_video(path: Path) -> None:
    VideoSink(path).on_start(RunInfo(64, 64, None))


def result(seed: int = 0) -> FrameResult:
    noise = np.random.default_rng(seed).integers(0, 255, (64, 64, 4), np.uint8)
    silence, ages = np.zeros(1600, np.float32), np.full(2, -1, np.int64)
    sensed = SensorFrame(0, 0, silence, None, np.zeros(2, bool), ages, False)
    return FrameResult(sensed, DrivenFrame(0, 0, np.zeros(256, np.float32), AHEAD), noise)


def write_picture(path: Path) -> None:
    sink = PictureSink(path.parent, 1)
    sink.on_start(RunInfo(64, 64, None))
    sink.on_frame(result())


@contextmanager
def full_disk(num_bytes: int) -> Generator[None]:
    """No file can grow over this size."""
    import resource

    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (num_bytes, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


WRITERS: dict[str, tuple[str, Callable[[Path], object]]] = {
    "video": ("out.mp4", start_video),
    "motion": ("out.npz", lambda path: save_npz(path, {"x": np.zeros(1)})),
    "ply": ("out.ply", lambda path: ply.save(path, ONE)),
    "gltf": ("out.glb", lambda path: gltf.save(path, ONE)),
    "film": ("out.mp4", lambda path: film(path, [np.zeros((64, 64, 3), np.uint8)] * 30)),
    "picture": ("frame_000000.png", write_picture),
    "calibration": ("eyes.json", lambda path: EyeCalibration().save(path)),
    "gaze": ("gaze.npz", lambda path: GazeGraph.load().save(path)),
    "weights": ("ben.safetensors", save_weights),
    "weights card": ("ben.json", save_weights),
    "checkpoint": ("eyes.safetensors", save_checkpoint),
    "checkpoint card": ("eyes.json", save_checkpoint),
    "key": (certificate.KEY_FILE, lambda path: certificate.ensure(path.parent, ["a"], 1e9)),
    "certificate": (certificate.NAMES_FILE, lambda path: certificate.ensure(path.parent, [], 1e9)),
}


@pytest.mark.parametrize("kind", WRITERS)
def test_nothing_is_written_through_a_link(tmp_path: Path, kind: str) -> None:
    name, write = WRITERS[kind]
    mine, folder = tmp_path / "mine", tmp_path / "sent"
    mine.write_bytes(MINE)
    folder.mkdir()
    (folder / name).symlink_to(mine)
    with pytest.raises(ValueError, match="got a link"):
        write(folder / name)
    assert mine.read_bytes() == MINE


@pytest.mark.parametrize("kind", ["video", "motion", "ply", "gltf", "calibration", "key"])
def test_what_shows_a_person_is_for_its_owner_alone(tmp_path: Path, kind: str) -> None:
    name, write = WRITERS[kind]
    write(tmp_path / name)
    assert (tmp_path / name).stat().st_mode & 0o777 == 0o600


@pytest.mark.parametrize("suffix", [".json", ".safetensors"])
def test_weights_are_read_through_no_link(tmp_path: Path, suffix: str) -> None:
    save_weights(tmp_path / "ben.json")
    moved = tmp_path / f"elsewhere{suffix}"
    shutil.move(tmp_path / f"ben{suffix}", moved)
    (tmp_path / f"ben{suffix}").symlink_to(moved)
    with pytest.raises(ValueError, match="got a link"):
        weights_file.load(tmp_path / "ben", "prior")


def test_a_report_goes_into_no_link(tmp_path: Path) -> None:
    (tmp_path / "mine").write_bytes(MINE)
    (tmp_path / "out.json").symlink_to(tmp_path / "mine")
    with pytest.raises(ValueError, match="got a link"):
        files.write_text(tmp_path / "out.json", json.dumps({}))
    assert (tmp_path / "mine").read_bytes() == MINE


@pytest.mark.skipif(sys.platform == "win32", reason="has no limit for the size of a file")
@pytest.mark.parametrize("kind", ["motion", "ply", "gltf", "film", "picture"])
def test_a_full_disk_leaves_what_was_there(tmp_path: Path, kind: str) -> None:
    """Red before: the first part of a picture, PLY, glTF or film in the place of the old one."""
    name, write = WRITERS[kind]
    (tmp_path / name).write_bytes(MINE)
    with full_disk(100), pytest.raises(OSError) as told:
        write(tmp_path / name)
    assert told.value.filename == str(tmp_path / name)
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [MINE]


@pytest.mark.skipif(sys.platform == "win32", reason="has no limit for the size of a file")
@pytest.mark.parametrize("num_bytes", [0, 20, 20_000])
@pytest.mark.parametrize("name", ["v.mp4", "v.mkv", "v.mov"])
def test_a_video_tells_of_a_full_disk(tmp_path: Path, name: str, num_bytes: int) -> None:
    """Red before: the program died of a header that found no room (mp4, mov), and a last part
    that found none was lost without a word."""
    with full_disk(num_bytes):
        sink = VideoSink(tmp_path / name)
        sink.on_start(RunInfo(64, 64, None))
        with suppress(OSError):
            for k in range(40):
                sink.on_frame(result(k))
        with pytest.raises(OSError) as told:
            sink.close()
    assert told.value.filename == str(tmp_path / name)


def test_weights_and_their_card_change_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Red before: new weights beside the old card, so that neither could be loaded."""
    save_weights(tmp_path / "mine.safetensors")
    monkeypatch.setattr(weights_file.json, "dumps", lambda *_, **__: "{" * (1 << 20))
    with pytest.raises(OSError, match="mine.json|large"), full_disk(100_000):
        weights_file.save(tmp_path / "mine", {"x": np.ones(1)}, {"kind": "prior"})
    tensors, _ = weights_file.load(tmp_path / "mine", "prior")
    assert tensors["x"] == 0
    assert len(list(tmp_path.iterdir())) == 2
