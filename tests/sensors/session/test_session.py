"""session create | info | export."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import soundfile
from material import frames, tone, video, wav

from sensors.session.export import export
from sensors.session.files import create, info
from sensors.session.recording import Recording
from sensors.types import NS, SAMPLE_RATE, InputError


def values(folder: Path, eye: int) -> list[int]:
    """The grey value that each frame sees; `video` makes picture k grey of value 5 * k."""
    return [-1 if f.eyes is None else int(f.eyes[eye, 200, 200]) for f in frames(folder)]


@pytest.mark.slow
@pytest.mark.parametrize("eye_codec", ["ffv1", "x264"])
def test_picture_k_is_seen_by_frame_k(tmp_path: Path, eye_codec: str) -> None:
    eyes = [video(tmp_path / "l.mkv", 45), video(tmp_path / "r.mp4", 45, codec="libx264")]
    made = create(tmp_path / "s", wav(tmp_path / "a.wav", 1.5), eyes, eye_codec=eye_codec)
    assert made["warnings"] == []
    expected = [5 * k for k in range(45)]
    for eye in (0, 1):
        seen = values(tmp_path / "s", eye)
        assert np.abs(np.subtract(seen, expected)).max() <= (0 if eye_codec == "ffv1" else 3) + eye
    assert all(f.eyes_valid.all() and (f.eyes_age_ns == 0).all() for f in frames(tmp_path / "s"))


@pytest.mark.parametrize("rate", [8000, 22_050, 44_100, 48_000, 96_000])
@pytest.mark.parametrize("channels", [1, 2])
def test_any_rate_and_channels(tmp_path: Path, rate: int, channels: int) -> None:
    made = create(tmp_path / "s", wav(tmp_path / "a.wav", 1.01, rate, channels))
    assert abs(made["audio_samples"] - 1.01 * SAMPLE_RATE) <= 1
    assert made["frames"] == 30
    assert 400 < made["partial_samples"] < 500
    assert bool(made["warnings"]) == (rate == 8000)
    got = np.concatenate([f.audio for f in frames(tmp_path / "s")])
    middle = slice(4800, -4800)
    assert np.abs(got - tone(1.0)[:, 0])[middle].max() < 2e-3


def test_times_come_from_counters_and_start_at_zero(tmp_path: Path) -> None:
    create(tmp_path / "s", wav(tmp_path / "a.wav", 1.0), created="yesterday")
    assert [f.t_ns for f in frames(tmp_path / "s")] == [(k + 1) * NS // 30 for k in range(30)]
    recording = Recording(tmp_path / "s")
    assert int(recording.audio.t_ns[0]) == 0
    assert recording.card["created"] == "yesterday"
    assert all(f.eyes is None for f in frames(tmp_path / "s"))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rate", "width", "height"), [(60, 640, 480), (24, 160, 120), (30, 800, 200)]
)
def test_eye_videos_of_any_size_and_rate(
    tmp_path: Path, rate: int, width: int, height: int
) -> None:
    eyes = [video(tmp_path / f"{k}.mkv", rate, rate=rate, width=width, height=height) for k in "lr"]
    create(tmp_path / "s", wav(tmp_path / "a.wav", 1.0), eyes)
    got = frames(tmp_path / "s")
    for frame in got[2:]:
        newest = (frame.t_ns + 1) * rate // NS - 1
        assert frame.eyes is not None
        assert abs(int(frame.eyes[0, 200, 200]) - 5 * newest % 256) <= 1
        assert frame.eyes_valid.all()


def test_scaling_keeps_the_centre_square(tmp_path: Path) -> None:
    import av

    with av.open(str(tmp_path / "w.mkv"), "w") as container:
        stream = container.add_stream("ffv1", rate=30)
        stream.width, stream.height, stream.pix_fmt = 1600, 800, "gray"
        wide = np.zeros((800, 1600), np.uint8)
        wide[:, 400:800] = 200  # left half of the centre square
        container.mux(stream.encode(av.VideoFrame.from_ndarray(wide, format="gray")))
        container.mux(stream.encode(None))
    create(tmp_path / "s", wav(tmp_path / "a.wav", 0.1), [tmp_path / "w.mkv"] * 2)
    eye = frames(tmp_path / "s")[-1].eyes
    assert eye is not None
    assert (eye[0, :, :199] == 200).all()
    assert (eye[0, :, 201:] == 0).all()


def test_an_eye_video_that_ends_early_is_held_then_invalid(tmp_path: Path) -> None:
    eyes = [video(tmp_path / "l.mkv", 60), video(tmp_path / "r.mkv", 30)]
    made = create(tmp_path / "s", wav(tmp_path / "a.wav", 2.0), eyes)
    assert len(made["warnings"]) == 1
    assert "r.mkv: ends at 1.00 s, the sound at 2.00 s" in made["warnings"][0]
    got = frames(tmp_path / "s")
    assert [bool(f.eyes_valid[1]) for f in got] == [True] * 33 + [False] * 27
    assert values(tmp_path / "s", 1)[29:] == [145] * 31
    assert all(f.eyes_valid[0] for f in got)


def test_pictures_after_the_sound_are_left_out(tmp_path: Path) -> None:
    eyes = [video(tmp_path / "l.mkv", 50)] * 2
    made = create(tmp_path / "s", wav(tmp_path / "a.wav", 1.0), eyes)
    assert made["eyes"]["left"]["pictures"] == 30
    assert made["seconds"] == 1.0


def test_clipped_sound_is_a_warning(tmp_path: Path) -> None:
    soundfile.write(tmp_path / "a.wav", np.clip(4 * tone(0.5), -1, 1), SAMPLE_RATE)
    [warning] = create(tmp_path / "s", tmp_path / "a.wav")["warnings"]
    assert "clipped" in warning
    soundfile.write(tmp_path / "b.wav", 2 * tone(0.5), SAMPLE_RATE)  # peaks at 1 and no more
    soundfile.write(tmp_path / "c.wav", 9 * tone(0.5), SAMPLE_RATE, "FLOAT")
    create(tmp_path / "s2", tmp_path / "c.wav")
    assert max(np.abs(f.audio).max() for f in frames(tmp_path / "s2")) <= 1


def test_flac_and_streamed_wav_are_read(tmp_path: Path) -> None:
    soundfile.write(tmp_path / "a.flac", tone(0.5), SAMPLE_RATE)
    assert create(tmp_path / "s", tmp_path / "a.flac")["frames"] == 15
    data = bytearray(wav(tmp_path / "b.wav", 0.5).read_bytes())
    data[40:44] = b"\xff\xff\xff\xff"  # written to a pipe: length unknown
    (tmp_path / "b.wav").write_bytes(data)
    assert create(tmp_path / "s2", tmp_path / "b.wav")["frames"] == 15


def test_export_opens_anywhere_and_is_in_step(tmp_path: Path) -> None:
    import av

    eyes = [video(tmp_path / "l.mkv", 30), video(tmp_path / "r.mkv", 30)]
    create(tmp_path / "s", wav(tmp_path / "a.wav", 1.02), eyes)
    made = export(tmp_path / "s", tmp_path / "out.mkv")
    assert made["frames"] == 30
    with av.open(str(tmp_path / "out.mkv")) as container:
        pictures = [f.to_ndarray(format="gray") for f in container.decode(video=0)]
    with av.open(str(tmp_path / "out.mkv")) as container:
        sound = np.concatenate([f.to_ndarray()[0] for f in container.decode(audio=0)])
    assert len(pictures) == 30
    assert pictures[0].shape == (400, 800)
    assert max(abs(int(p[200, 600]) - 5 * k) for k, p in enumerate(pictures)) <= 4
    assert np.abs(sound / 32768 - tone(1.0)[:, 0]).max() < 1e-4
    create(tmp_path / "voice", tmp_path / "a.wav")
    assert export(tmp_path / "voice", tmp_path / "voice.mkv")["frames"] == 30


def test_export_replaces_no_file_of_the_session(tmp_path: Path) -> None:
    """Red before: `session export DIR DIR/eye_left.mkv` left an eye of no bytes."""
    eyes = [video(tmp_path / "l.mkv", 15), video(tmp_path / "r.mkv", 15)]
    create(tmp_path / "s", wav(tmp_path / "a.wav", 0.5), eyes)
    eye = tmp_path / "s" / "eye_left.mkv"
    whole = eye.read_bytes()
    with pytest.raises(InputError, match="another place than the session's own"):
        export(tmp_path / "s", eye)
    assert eye.read_bytes() == whole


def test_an_export_that_fails_leaves_what_was_there(tmp_path: Path) -> None:
    """Red before: the older file was emptied first."""
    create(tmp_path / "s", wav(tmp_path / "a.wav", 0.5))
    (tmp_path / "out.mkv").write_text("mine")

    def broken(_: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        export(tmp_path / "s", tmp_path / "out.mkv", progress=broken)
    assert (tmp_path / "out.mkv").read_text() == "mine"
    assert {path.name for path in tmp_path.iterdir()} == {"s", "a.wav", "out.mkv"}


def test_an_export_of_no_frames_leaves_what_was_there(tmp_path: Path) -> None:
    create(tmp_path / "s", wav(tmp_path / "a.wav", 0.01))
    (tmp_path / "out.mkv").write_text("mine")
    with pytest.raises(InputError, match=r"one frame of sound \(1600 samples\), got 480"):
        export(tmp_path / "s", tmp_path / "out.mkv")
    assert (tmp_path / "out.mkv").read_text() == "mine"


def test_an_export_tells_what_is_missing(tmp_path: Path) -> None:
    """Red before: held pictures, and not a word."""
    eyes = [video(tmp_path / "l.mkv", 15), video(tmp_path / "r.mkv", 15)]
    create(tmp_path / "s", wav(tmp_path / "a.wav", 0.5), eyes)
    assert export(tmp_path / "s", tmp_path / "out.mkv")["warnings"] == []
    eye = tmp_path / "s" / "eye_left.mkv"
    eye.write_bytes(eye.read_bytes()[: eye.stat().st_size // 2])
    [warning] = export(tmp_path / "s", tmp_path / "out.mkv")["warnings"]
    assert re.search(r"[5-9] eye pictures are missing; restore the eye videos", warning)
    assert export(tmp_path / "s", tmp_path / "out.mkv", drop="eyes")["warnings"] == []


def test_info_is_plain_values(tmp_path: Path) -> None:
    eyes = [video(tmp_path / "l.mkv", 30)] * 2
    create(tmp_path / "s", wav(tmp_path / "a.wav", 1.0), eyes)
    got = json.loads(json.dumps(info(tmp_path / "s")))
    assert got["frames"] == 30
    assert got["eyes"]["right"] == {
        "pictures": 30,
        "missing": 0,
        "rate_hz": 30.0,
        "first_s": 0.033333,
        "last_s": 1.0,
        "codec": "ffv1",
    }


def test_info_knows_of_a_cut_video(tmp_path: Path) -> None:
    """Red before: 30 pictures, as many as the timeline has."""
    create(tmp_path / "s", wav(tmp_path / "a.wav", 1.0), [video(tmp_path / "l.mkv", 30)] * 2)
    eye = tmp_path / "s" / "eye_left.mkv"
    eye.write_bytes(eye.read_bytes()[: eye.stat().st_size // 2])
    eyes = info(tmp_path / "s")["eyes"]
    assert 10 < eyes["left"]["missing"] < 20 and eyes["right"]["missing"] == 0
