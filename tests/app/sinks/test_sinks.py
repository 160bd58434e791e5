"""Sinks: named blendshapes, repeatable files, playable video."""

import csv
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from app.drive.sink import FrameResult, RunInfo
from app.face.arkit import ARKIT_NAMES, arkit
from app.sinks.arkit import ArkitSink, timecode
from app.sinks.motion import MotionSink
from app.sinks.video import VideoSink, film
from encoder.types import DrivenFrame
from render.decoder import identity
from render.decoder.decoder import Decoder
from render.types import AHEAD
from sensors.types import FPS, NS, SAMPLE_RATE, SAMPLES_PER_FRAME, InputError, SensorFrame


def result(index: int, code: np.ndarray, picture: np.ndarray | None = None) -> FrameResult:
    t_ns = (index + 1) * NS // FPS
    sound = 0.3 * np.sin(np.arange(SAMPLES_PER_FRAME, dtype=np.float32) * 0.05)
    ages = np.full(2, -1, np.int64)
    frame = SensorFrame(index, t_ns, sound, None, np.zeros(2, bool), ages, False)
    return FrameResult(frame, DrivenFrame(index, t_ns, code, AHEAD), picture)


def test_every_arkit_name_but_the_tongue_has_a_source(decoder: Decoder) -> None:
    assert len(set(ARKIT_NAMES)) == 52
    full = arkit(np.ones((1, 53), np.float32), AHEAD[None], decoder.rig_names)[0]
    still = [n for n, v in zip(ARKIT_NAMES, full, strict=True) if v == 0]
    assert [n for n in still if "eyeLook" not in n] == ["tongueOut"]


def test_each_channel_reaches_its_namesake(decoder: Decoder) -> None:
    for name, expected in {
        "mouthSmile_L": "mouthSmileLeft",
        "jawLeft": "jawLeft",
        "mouthRight": "mouthRight",
        "jawOpen": "jawOpen",
        "eyeBlink_R": "eyeBlinkRight",
    }.items():
        rig = np.zeros((1, 53), np.float32)
        rig[0, decoder.rig_names.index(name)] = 0.7
        values = arkit(rig, AHEAD[None], decoder.rig_names)[0]
        assert [n for n, v in zip(ARKIT_NAMES, values, strict=True) if v > 0] == [expected]


def test_looking_to_the_subjects_left(decoder: Decoder) -> None:
    left = np.tile(np.array([np.sin(0.3), 0, np.cos(0.3)], np.float32), (2, 1))
    values = arkit(np.zeros((1, 53), np.float32), left[None], decoder.rig_names)[0]
    moved = {n for n, v in zip(ARKIT_NAMES, values, strict=True) if v > 0}
    assert moved == {"eyeLookOutLeft", "eyeLookInRight"}


def test_the_table_has_the_layout_of_live_link_face(tmp_path: Path, decoder: Decoder) -> None:
    sink = ArkitSink(tmp_path / "a.csv", decoder)
    sink.on_start(RunInfo(64, 64, 2))
    for k in range(2):
        sink.on_frame(result(k, np.zeros(256, np.float32)))
    sink.close()
    header, *rows = csv.reader((tmp_path / "a.csv").open())
    assert header[:3] == ["Timecode", "BlendShapeCount", "EyeBlinkLeft"]
    assert header[-1] == "RightEyeRoll" and len(header) == 63
    assert [row[0] for row in rows] == ["00:00:00:00.000", "00:00:00:01.000"]
    assert {row[1] for row in rows} == {"61"}
    assert timecode(30 * 3661 + 7) == "01:01:01:07.000"


def test_motion_files_of_equal_runs_are_equal(tmp_path: Path, decoder: Decoder) -> None:
    who = identity.load("ben")
    for name in ("a.npz", "b.npz"):
        sink = MotionSink(tmp_path / name, decoder, who)
        sink.on_start(RunInfo(64, 64, 3))
        for k in range(3):
            sink.on_frame(result(k, np.full(256, 0.01 * k, np.float32)))
        sink.close()
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    motion = np.load(tmp_path / "a.npz", allow_pickle=False)
    assert motion["lips_mm"].shape == (3, 885, 3)
    assert motion["upper_face_mm"].shape == (3, 2469, 3)
    assert motion["arkit"].shape == (3, 52) and len(motion["arkit_names"]) == 52


def test_a_long_motion_file_is_written_in_pieces(tmp_path: Path, decoder: Decoder) -> None:
    """Red before: vertices of all frames were held at once, three times over: 13 GB an hour."""
    who, count = identity.load("ben"), 400
    rng = np.random.default_rng(2)
    sink = MotionSink(tmp_path / "m.npz", decoder, who)
    codes = [decoder.sample(rng) for _ in range(count)]
    for k, code in enumerate(codes):
        sink.on_frame(result(k, code))
    tracemalloc.start()
    sink.close()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    motion = np.load(tmp_path / "m.npz", allow_pickle=False)
    vertices = motion["lips_mm"].nbytes + motion["upper_face_mm"].nbytes
    assert peak < vertices / 4, f"{peak / 1e6:.1f} MB for {vertices / 1e6:.1f} MB of vertices"
    expected = decoder.vertices(codes[-1], AHEAD, who)
    np.testing.assert_array_equal(motion["lips_mm"][-1], expected[decoder.regions["lips"]])
    np.testing.assert_array_equal(
        motion["upper_face_mm"][-1], expected[decoder.regions["upper_face"]]
    )


def test_video_has_picture_and_sound_of_equal_length(tmp_path: Path) -> None:
    import av

    sink = VideoSink(tmp_path / "v.mp4")
    sink.on_start(RunInfo(64, 64, 45))
    for k in range(45):
        picture = np.full((64, 64, 4), 4 * k, np.uint8) if k % 3 == 0 else None
        sink.on_frame(result(k, np.zeros(256, np.float32), picture))
    sink.close()
    with av.open(str(tmp_path / "v.mp4")) as container:
        frames = list(container.decode(video=0))
    with av.open(str(tmp_path / "v.mp4")) as container:
        samples = sum(f.samples for f in container.decode(audio=0))
    assert len(frames) == 45
    assert abs(samples - 45 * SAMPLES_PER_FRAME) <= 2048  # AAC pads its last block
    grey = frames[-1].to_ndarray(format="gray")
    assert abs(float(grey.mean()) - 4 * 42) < 8  # the last picture is repeated, not black


@pytest.mark.parametrize("name", ["v.mp4", "v.mkv", "v.mov"])
def test_pictures_and_sound_begin_at_once_and_stay_in_step(tmp_path: Path, name: str) -> None:
    """Red before: both began at 67 ms in MP4, and the sound early by 45 ms where times are not
    looked at, as in a WAV made of it."""
    import av

    sink = VideoSink(tmp_path / name)
    sink.on_start(RunInfo(64, 64, 45))
    for k in range(45):
        made = result(k, np.zeros(256, np.float32), np.full((64, 64, 4), 255 * (k == 30), np.uint8))
        made.sensors.audio[:] *= k == 30
        sink.on_frame(made)
    sink.close()
    with av.open(str(tmp_path / name)) as container:
        frames = list(container.decode(video=0))
    with av.open(str(tmp_path / name)) as container:
        sound = np.concatenate([f.to_ndarray()[0] for f in container.decode(audio=0)])
    bright = [f.time for f in frames if f.to_ndarray(format="gray").mean() > 128]
    assert (frames[0].time, bright) == (0, [pytest.approx(1, abs=1e-3)])
    assert np.flatnonzero(np.abs(sound) > 0.1)[0] / SAMPLE_RATE == pytest.approx(1, abs=0.01)


def test_colours_are_those_of_the_tag(tmp_path: Path) -> None:
    """Red before: no tag, so that players took large pictures for BT.709, which they were not."""
    import av

    shown = np.full((64, 64, 3), (200, 40, 90), np.uint8)
    film(tmp_path / "film.mp4", [shown] * 3)
    sink = VideoSink(tmp_path / "v.mp4")
    sink.on_start(RunInfo(64, 64, 3))
    for k in range(3):
        picture = np.full((64, 64, 4), (200, 40, 90, 255), np.uint8)
        sink.on_frame(result(k, np.zeros(256, np.float32), picture))
    sink.close()
    for name in ("film.mp4", "v.mp4"):
        with av.open(str(tmp_path / name)) as container:
            context = container.streams.video[0].codec_context
            tags = context.colorspace, context.color_primaries, context.color_trc
            y, u, v = np.split(next(container.decode(video=0)).to_ndarray().ravel(), [4096, 5120])
        assert tags == (1, 1, 1) and context.color_range == 1  # BT.709, 16 to 235
        luma, red = 255 / 219 * (y.mean() - 16), 255 / 224 * (v.mean() - 128)
        blue = 255 / 224 * (u.mean() - 128)
        assert luma + 1.5748 * red == pytest.approx(200, abs=3)
        assert luma - 0.1873 * blue - 0.4681 * red == pytest.approx(40, abs=3)
        assert luma + 1.8556 * blue == pytest.approx(90, abs=3)


@pytest.mark.parametrize("name", ["v.mp4", "v.mkv", "v.MOV"])
def test_a_video_that_is_broken_off_plays(tmp_path: Path, name: str) -> None:
    """Red before: 36 bytes of the first seven seconds of a head, as nothing left a buffer of 256
    kB."""
    import av

    sink = VideoSink(tmp_path / name)
    sink.on_start(RunInfo(64, 64, None))
    for k in range(80):
        sink.on_frame(result(k, np.zeros(256, np.float32), np.full((64, 64, 4), k, np.uint8)))
    with av.open(str(tmp_path / name)) as container:
        assert len(list(container.decode(video=0))) >= 30
    sink.close()


@pytest.mark.parametrize("name", ["v.avi", "v", "missing/v.mp4"])
def test_a_bad_video_name_is_refused_at_once(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError):
        VideoSink(tmp_path / name)
