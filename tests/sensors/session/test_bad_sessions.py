"""One clear line for each kind of bad input of session create | info | export."""

import json
import os
from pathlib import Path

import numpy as np
import pytest
import soundfile
from material import tone, video, wav

from sensors.session.export import export
from sensors.session.files import create, info
from sensors.session.recording import Recording, RecordingWriter
from sensors.types import (
    SAMPLE_RATE,
    AudioPacket,
    EmotionPacket,
    HeadPacket,
    HeadPose,
    InputError,
)


def cut(path: Path, keep: float) -> Path:
    os.truncate(path, int(path.stat().st_size * keep))
    return path


def nan_wav(path: Path) -> Path:
    samples = tone(1.0)
    samples[24_000] = np.nan
    soundfile.write(path, samples, SAMPLE_RATE, "FLOAT")
    return path


def text(path: Path) -> Path:
    path.write_text("hello " * 500)
    return path


def flac(path: Path) -> Path:
    noise = np.random.default_rng(0).uniform(-0.5, 0.5, 3 * SAMPLE_RATE)
    soundfile.write(path, noise, SAMPLE_RATE)
    return path


def one_line(error: pytest.ExceptionInfo[InputError]) -> str:
    message = str(error.value)
    assert "\n" not in message
    assert "expected" in message
    assert "got" in message
    return message


BAD_SOUND = {
    "no such file": lambda d: d / "none.wav",
    "something else": lambda d: text(d / "a.wav"),
    "truncated": lambda d: cut(wav(d / "a.wav"), 0.5),
    "truncated: expected 144000": lambda d: cut(flac(d / "a.flac"), 0.5),
    "empty": lambda d: wav(d / "a.wav", 0.0),
    "a.raw": lambda d: text(d / "a.raw"),
    "NaN or infinity at 0.500 s": lambda d: nan_wav(d / "a.wav"),
}


@pytest.mark.parametrize("words", BAD_SOUND)
def test_bad_sound(tmp_path: Path, words: str) -> None:
    path = BAD_SOUND[words](tmp_path)
    with pytest.raises(InputError, match=words) as error:
        create(tmp_path / "s", path)
    one_line(error)
    assert not (tmp_path / "s").exists()


BAD_EYES = {
    "no such file": lambda d: d / "none.mkv",
    "expected a video": lambda d: text(d / "x.mkv"),
    "no picture stream": lambda d: wav(d / "x.wav"),
    "at least 32 x 32": lambda d: video(d / "x.mkv", 3, width=16, height=16),
    "got something else": lambda d: cut(video(d / "x.mkv", 3), 0.27),
    "got no picture in it": lambda d: text(d / "x.jpg"),
    "got a text file": lambda d: text(d / "x.txt"),
}


@pytest.mark.parametrize("words", BAD_EYES)
def test_bad_eyes(tmp_path: Path, words: str) -> None:
    path = BAD_EYES[words](tmp_path)
    with pytest.raises(InputError, match=words) as error:
        create(tmp_path / "s", wav(tmp_path / "a.wav"), [video(tmp_path / "l.mkv"), path])
    one_line(error)
    assert not (tmp_path / "s").exists()


def test_bad_create_calls(tmp_path: Path) -> None:
    sound = wav(tmp_path / "a.wav")
    with pytest.raises(InputError, match="two videos") as error:
        create(tmp_path / "s", sound, [video(tmp_path / "l.mkv")])
    one_line(error)
    create(tmp_path / "s", sound)
    with pytest.raises(InputError, match="new or empty folder") as error:
        create(tmp_path / "s", sound)
    one_line(error)
    assert info(tmp_path / "s")["frames"] == 30  # the old one is untouched


def edit(folder: Path, **fields: object) -> None:
    card = json.loads((folder / "session.json").read_text())
    (folder / "session.json").write_text(json.dumps(card | fields))


def wrong_size(folder: Path) -> None:
    (folder / "eye_left.mkv").unlink()
    video(folder / "eye_left.mkv", 3, width=320, height=240)


BAD_SESSIONS = {
    "not a session": lambda d: (d / "session.json").unlink(),
    "expected JSON": lambda d: (d / "session.json").write_text("{"),
    "another file": lambda d: edit(d, format="x"),
    "the newer 2": lambda d: edit(d, version=2),
    "version": lambda d: edit(d, version="one"),
    "bad line 3": lambda d: (d / "timeline.jsonl").write_bytes(
        b"".join((d / "timeline.jsonl").read_bytes().splitlines(True)[:2]) + b"{}\n"
    ),
    "negative picture": lambda d: renumber(d, -1),
    "timeline, got no file": lambda d: (d / "timeline.jsonl").unlink(),
    "sound, got no file": lambda d: (d / "audio.wav").unlink(),
    "is truncated": lambda d: cut(d / "audio.wav", 0.5),
    "48000 Hz mono": lambda d: wav(d / "audio.wav", 1.0, 8000),
    "2 channel": lambda d: wav(d / "audio.wav", 1.0, 48_000, 2),
    "expected a WAV file": lambda d: text(d / "audio.wav"),
    "no such file": lambda d: (d / "eye_left.mkv").unlink(),
    "expected a video": lambda d: text(d / "eye_left.mkv"),
    "400 x 400, got 320 x 240": wrong_size,
}


def renumber(folder: Path, picture: int) -> None:
    """The picture that the last line of an eye names."""
    path = folder / "timeline.jsonl"
    lines = path.read_bytes().splitlines(True)
    at = max(k for k, line in enumerate(lines) if b"eye_" in line)
    fields = json.loads(lines[at]) | {"picture": picture}
    lines[at] = json.dumps(fields).encode() + b"\n"
    path.write_bytes(b"".join(lines))


def shorten(folder: Path, *, lines: slice) -> None:
    path = folder / "timeline.jsonl"
    path.write_bytes(b"".join(path.read_bytes().splitlines(True)[lines]))


def without(folder: Path, stream: bytes) -> None:
    """Delete the first line of a stream."""
    path = folder / "timeline.jsonl"
    lines = path.read_bytes().splitlines(True)
    lines.remove(next(line for line in lines if stream in line))
    path.write_bytes(b"".join(lines))


def swap_sounds(folder: Path) -> None:
    """The first two packets of sound change places; all counts stay right."""
    path = folder / "timeline.jsonl"
    lines = path.read_bytes().splitlines(True)
    first, second = [k for k, line in enumerate(lines) if b"audio" in line][:2]
    lines[first], lines[second] = lines[second], lines[first]
    path.write_bytes(b"".join(lines))


BAD_SESSIONS |= {
    "timeline.jsonl: expected sound from sample 3200 on, got 0": swap_sounds,
    "4800 samples of sound, as session.json counts, got 0": lambda d: shorten(d, lines=slice(0)),
    "4800 samples of sound, as session.json counts, got 3200": lambda d: without(d, b"audio"),
    "3 pictures of eye_right, as session.json counts, got 2": lambda d: without(d, b"eye_right"),
    "expected 4800 samples": lambda d: shorten(d, lines=slice(2)),
    "an object as counts": lambda d: edit(d, counts=[1]),
}


@pytest.mark.parametrize(("stream", "what"), [(b"emotion", "emotions"), (b"head", "poses of the")])
def test_lines_of_head_and_emotion_are_counted(tmp_path: Path, stream: bytes, what: str) -> None:
    """Red before: opened without them."""
    pose = HeadPose((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
    with RecordingWriter(tmp_path / "s", created="") as writer:
        writer.append(AudioPacket(0, 0, np.zeros(1600, np.float32)))
        for t_ns in range(2):
            writer.append(HeadPacket(t_ns, pose, True))
            writer.append(EmotionPacket(t_ns, "happy"))
    held = info(tmp_path / "s")
    assert (held["head_poses"], held["emotions"]) == (2, 2)
    without(tmp_path / "s", stream)
    with pytest.raises(InputError, match=f"2 {what}.* as session.json counts, got 1"):
        info(tmp_path / "s")


@pytest.mark.parametrize("words", BAD_SESSIONS)
def test_bad_sessions(tmp_path: Path, words: str) -> None:
    eyes = [video(tmp_path / "l.mkv", 3)] * 2
    create(tmp_path / "s", wav(tmp_path / "a.wav", 0.1), eyes)
    BAD_SESSIONS[words](tmp_path / "s")
    with pytest.raises(InputError, match=words) as error:
        info(tmp_path / "s")
    one_line(error)


def test_a_card_that_counts_nothing_is_opened(tmp_path: Path) -> None:
    create(tmp_path / "s", wav(tmp_path / "a.wav", 0.1))
    card = json.loads((tmp_path / "s" / "session.json").read_text())
    del card["counts"]
    (tmp_path / "s" / "session.json").write_text(json.dumps(card))
    shorten(tmp_path / "s", lines=slice(1))
    assert info(tmp_path / "s")["frames"] == 1


def test_bad_folders(tmp_path: Path) -> None:
    for path in (tmp_path / "none", tmp_path):
        with pytest.raises(InputError, match="not a session") as error:
            Recording(path)
        one_line(error)
    create(tmp_path / "s", wav(tmp_path / "a.wav", 0.1))
    for out in (tmp_path / "x.mp4", tmp_path / "none" / "x.mkv"):
        with pytest.raises(InputError, match=r"try x.mkv|create it first") as error:
            export(tmp_path / "s", out)
        one_line(error)
