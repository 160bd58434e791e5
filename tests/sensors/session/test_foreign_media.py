"""Media as people have them: phone sound, both eyes in one video; folders with files of others."""

from pathlib import Path

import av
import numpy as np
import pytest
import soundfile

from sensors.session import files as session
from sensors.session.recording import Recording
from sensors.types import SAMPLE_RATE, InputError

SECONDS = 2


def phone_sound(path: Path, codec: str) -> Path:
    """Two seconds of 300 Hz as a phone writes it."""
    t = np.arange(SECONDS * SAMPLE_RATE) / SAMPLE_RATE
    tone = (0.3 * np.sin(2 * np.pi * 300 * t)).astype(np.float32)
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=SAMPLE_RATE)
        stream.layout = "mono"
        for start in range(0, len(tone), 960):
            chunk = tone[None, start : start + 960]
            frame = av.AudioFrame.from_ndarray(chunk, format="fltp", layout="mono")
            frame.sample_rate, frame.pts = SAMPLE_RATE, start
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def both_eyes(path: Path, width: int = 320, height: int = 160) -> Path:
    """Left half dark, right half bright."""
    image = np.full((height, width), 40, np.uint8)
    image[:, width // 2 :] = 200
    with av.open(str(path), "w") as container:
        stream = container.add_stream("ffv1", rate=30)
        stream.width, stream.height, stream.pix_fmt = width, height, "gray"
        for _ in range(30 * SECONDS):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="gray")))
        container.mux(stream.encode(None))
    return path


@pytest.mark.parametrize(("suffix", "codec"), [("m4a", "aac"), ("mov", "aac"), ("webm", "libopus")])
def test_sound_of_a_phone_becomes_a_session(tmp_path: Path, suffix: str, codec: str) -> None:
    """Red before: refused, though PyAV reads it."""
    made = session.create(tmp_path / "s", phone_sound(tmp_path / f"a.{suffix}", codec))
    assert abs(made["seconds"] - SECONDS) < 0.1
    with Recording(tmp_path / "s") as recording:
        sound = np.concatenate([f.audio for f in session.replay_frames(recording)])
    middle = sound[SAMPLE_RATE // 2 : SAMPLE_RATE * 3 // 2]
    spectrum = np.abs(np.fft.rfft(middle))
    assert np.argmax(spectrum) * SAMPLE_RATE / len(middle) == pytest.approx(300, abs=2)


@pytest.mark.slow
def test_one_video_of_both_eyes_is_split(tmp_path: Path) -> None:
    sound = phone_sound(tmp_path / "a.m4a", "aac")
    session.create(tmp_path / "s", sound, [both_eyes(tmp_path / "both.mkv")])
    with Recording(tmp_path / "s") as recording:
        frame = list(session.replay_frames(recording))[20]
    assert frame.eyes is not None
    assert [int(view.mean()) for view in frame.eyes] == [40, 200]


def test_a_video_of_one_eye_is_not_split(tmp_path: Path) -> None:
    sound = phone_sound(tmp_path / "a.m4a", "aac")
    one = both_eyes(tmp_path / "one.mkv", width=200)
    with pytest.raises(InputError, match="side by side"):
        session.create(tmp_path / "s", sound, [one])
    assert not (tmp_path / "s").exists()


def test_files_of_others_survive_a_failed_create(tmp_path: Path) -> None:
    """Red before: everything in the folder was deleted."""
    (tmp_path / "s").mkdir()
    (tmp_path / "s" / "notes.txt").write_text("mine")
    (tmp_path / "a.wav").write_bytes(b"no sound")
    with pytest.raises(InputError):
        session.create(tmp_path / "s", tmp_path / "a.wav")
    assert (tmp_path / "s" / "notes.txt").read_text() == "mine"


@pytest.mark.parametrize(
    ("left", "right", "words"),
    [
        (1.0, -1.0, ["its channels cancel each other", "give one of them"]),
        (0.0, 0.0, ["the sound is silent"]),
        (0.0, 1.0, []),
        (1.0, 0.3, []),
    ],
)
def test_sound_that_is_lost_is_told(
    tmp_path: Path, left: float, right: float, words: list[str]
) -> None:
    """Red before: opposite channels became a session of silence without a word."""
    tone = 0.3 * np.sin(np.arange(SAMPLE_RATE) / 20)
    soundfile.write(tmp_path / "a.wav", np.stack([left * tone, right * tone], 1), SAMPLE_RATE)
    warnings = session.create(tmp_path / "s", tmp_path / "a.wav")["warnings"]
    assert len(warnings) == bool(words)
    assert all(word in warnings[0] for word in words)


def heard(folder: Path) -> float:
    """Loudest sample of a session."""
    with Recording(folder) as recording:
        return max(float(np.abs(f.audio).max()) for f in session.replay_frames(recording))


@pytest.mark.parametrize("other", [0.0, 1e-4])  # nothing, or noise of an input without microphone
def test_a_microphone_on_one_channel_is_as_loud_as_it_was(tmp_path: Path, other: float) -> None:
    """Red before: half as loud, as a channel without a voice was part of the mean."""
    tone = 0.3 * np.sin(np.arange(SAMPLE_RATE) / 20)
    noise = other * np.random.default_rng(0).standard_normal(SAMPLE_RATE)
    soundfile.write(tmp_path / "a.wav", np.stack([noise, tone], 1), SAMPLE_RATE)
    session.create(tmp_path / "s", tmp_path / "a.wav")
    assert heard(tmp_path / "s") == pytest.approx(0.3, abs=0.002)


def test_a_microphone_on_one_channel_of_a_film_is_as_loud_as_it_was(tmp_path: Path) -> None:
    """PyAV reads it. Red before: half as loud."""
    tone = (0.3 * np.sin(np.arange(SAMPLE_RATE) / 20)).astype(np.float32)
    with av.open(str(tmp_path / "a.mov"), "w") as container:
        stream = container.add_stream("pcm_s16le", rate=SAMPLE_RATE, layout="stereo")
        both = np.stack([tone, np.zeros_like(tone)])
        frame = av.AudioFrame.from_ndarray(both, format="fltp", layout="stereo")
        frame.sample_rate = SAMPLE_RATE
        container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    session.create(tmp_path / "s", tmp_path / "a.mov")
    assert heard(tmp_path / "s") == pytest.approx(0.3, abs=0.002)


def test_sound_that_stands_in_for_none_is_not_judged(tmp_path: Path) -> None:
    """As of a Live Link Face take without a sound file."""
    soundfile.write(tmp_path / "a.wav", np.zeros(SAMPLE_RATE), SAMPLE_RATE)
    assert session.create(tmp_path / "s", tmp_path / "a.wav", heard=False)["warnings"] == []


def test_a_folder_or_a_cut_film_is_told_as_such(tmp_path: Path) -> None:
    """Red before: "no such file" of a folder that is there, and a number of libav's errors."""
    whole = phone_sound(tmp_path / "a.m4a", "aac").read_bytes()
    (tmp_path / "cut.m4a").write_bytes(whole[: len(whole) // 2])
    for name, got in (("", "a folder"), ("cut.m4a", r"something else, or one that is cut off \(I")):
        with pytest.raises(InputError, match=f"expected a sound file, got {got}"):
            session.create(tmp_path / "s", tmp_path / name)
        with pytest.raises(InputError, match=f"expected (a|an eye) video, got {got}"):
            session.create(tmp_path / "s", tmp_path / "a.m4a", [tmp_path / name])
    assert not (tmp_path / "s").exists()


@pytest.mark.parametrize(
    ("folder", "got"),
    [
        ("a.m4a", "a new or empty folder, got a file; choose"),
        ("a.m4a/s", "a folder to write into, got .*: Not a directory; choose"),
        ("/proc/s", "a folder to write into, got /proc/s: No such file or directory; choose"),
    ],
)
def test_a_session_that_cannot_be_made_there_is_told(folder: str, got: str, tmp_path: Path) -> None:
    """Red before: of a file of somebody's that it has files in it and may be removed, of the
    others that they should exist."""
    sound = phone_sound(tmp_path / "a.m4a", "aac")
    with pytest.raises(InputError, match=f"expected {got} another"):
        session.create(tmp_path / folder, sound)
    assert sound.is_file()
