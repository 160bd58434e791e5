"""Importing one's own takes: good ones become sessions, bad ones end in one clear line."""

import json
from pathlib import Path

import numpy as np
import pytest
import soundfile

from app.commands.session import CreateSession
from app.face.arkit import ARKIT_NAMES
from encoder.capture.motion.channels import JAW_OPEN
from encoder.capture.motion.rules import speech_curves
from encoder.capture.motion.style import Style
from encoder.capture.speech.phones import PHONES, Phone
from encoder.capture.speech.synthesis import speak_flite
from encoder.capture.subjects import mocap, real
from encoder.capture.subjects import plans as build
from encoder.capture.subjects.livelink import read_livelink
from sensors.types import SAMPLE_RATE, InputError

NAMES = [name[0].upper() + name[1:] for name in ARKIT_NAMES]


def write_take(path: Path, rows: int = 90, step: int = 2, names: list[str] | None = None) -> Path:
    """A take at 60 timecodes a second, one row every `step` of them; the jaw opens slowly."""
    names = NAMES if names is None else names
    lines = [",".join(["Timecode", "BlendShapeCount", *names])]
    for k in range(rows):
        frame = k * step
        values = [f"{k / rows:.4f}" if n == "JawOpen" else "0.1" for n in names]
        code = f"10:00:{frame // 60:02d}:{frame % 60:02d}.250"
        lines.append(",".join([code, "61", *values]))
    path.write_text("\n".join(lines))
    return path


def write_sound(path: Path, seconds: float) -> Path:
    soundfile.write(path, 0.1 * np.sin(np.arange(int(seconds * SAMPLE_RATE)) * 0.05), SAMPLE_RATE)
    return path


def test_a_take_becomes_a_session_with_motion(tmp_path, capsys):
    take, sound = write_take(tmp_path / "a.csv"), write_sound(tmp_path / "a.wav", 3.2)
    CreateSession(folder=tmp_path / "s", audio=sound, livelink=take).run()
    assert json.loads(capsys.readouterr().out.split("\nnext:")[0])["frames"] == 96
    with np.load(tmp_path / "s" / "motion.npz", allow_pickle=False) as motion:
        jaw = motion["arkit"][:, list(motion["arkit_names"]).index("jawOpen")]
        np.testing.assert_allclose(jaw[:80], np.arange(80) / 90, atol=2e-3)  # row k in frame k
        assert motion["rig"].shape == (96, 53) and motion["gaze"].shape == (96, 2, 3)
        assert motion["t_ns"][29] == 1_000_000_000


def test_a_take_without_sound_gets_silence(tmp_path, capsys):
    CreateSession(folder=tmp_path / "s", livelink=write_take(tmp_path / "a.csv")).run()
    sound, _ = soundfile.read(tmp_path / "s" / "audio.wav")
    assert not sound.any() and len(sound) >= 2.9 * SAMPLE_RATE
    assert "warning" not in capsys.readouterr().out  # the silence is ours


def spoil(path: Path, line: int, text: str) -> Path:
    lines = path.read_text().splitlines()
    lines[line] = text
    path.write_text("\n".join(lines))
    return path


def test_bad_takes_say_what_is_wrong(tmp_path):
    path = tmp_path / "t.csv"
    with pytest.raises(InputError, match="got no MouthClose; record in ARKit mode"):
        read_livelink(write_take(path, names=[n for n in NAMES if n != "MouthClose"]))
    with pytest.raises(InputError, match="got no Timecode, BrowDownLeft, .* and more"):
        read_livelink(spoil(write_take(path), 0, "a,b,c"))
    with pytest.raises(InputError, match=r"24-60 rows a second, got 1\d"):
        read_livelink(write_take(path, step=5))
    with pytest.raises(InputError, match=r"line 12: expected a timecode"):
        read_livelink(spoil(write_take(path), 11, "10:00:00:20,61,oops"))
    lines = write_take(path).read_text().splitlines()
    path.write_text("\n".join([*lines[:20], *lines[60:]]))
    with pytest.raises(InputError, match=r"line 21: expected gaps under 0.5 s, got 1.37 s"):
        read_livelink(path)
    path.write_text("\n".join([lines[0], *reversed(lines[1:])]))
    with pytest.raises(InputError, match="expected time to rise"):
        read_livelink(path)
    path.write_text(lines[0])
    with pytest.raises(InputError, match="at least 2 rows"):
        read_livelink(path)


@pytest.mark.parametrize(("value", "got"), [("nan", "'nan'"), ("7.5", "'7.5'"), ("", "''")])
def test_a_weight_is_a_number_of_0_to_1(tmp_path, value, got):
    path = write_take(tmp_path / "t.csv")
    row = path.read_text().splitlines()[11].split(",")
    with pytest.raises(InputError, match=f"line 12: .*numbers from -0.5 to 1.5, got {got}"):
        read_livelink(spoil(path, 11, ",".join([*row[:-1], value])))


@pytest.mark.parametrize("rate", [24, 25, 30, 60])
def test_timecodes_of_every_rate_run_evenly(tmp_path, rate):
    path = write_take(tmp_path / "t.csv", rows=150)
    lines = path.read_text().splitlines()
    for k, line in enumerate(lines[1:]):
        code = f"10:00:{k // rate:02d}:{k % rate:02d}.000"
        lines[k + 1] = ",".join([code, *line.split(",")[1:]])
    path.write_text("\n".join(lines))
    np.testing.assert_allclose(np.diff(read_livelink(path).times), 1 / rate, atol=1e-6)


def test_a_take_over_midnight_goes_on_and_a_lost_face_is_left_out(tmp_path):
    """Red before: expected time to rise; and that line 3 was to be repaired or deleted."""
    path = write_take(tmp_path / "t.csv", rows=20)
    lines = path.read_text().splitlines()
    codes = [f"23:59:59:{k}.000" for k in range(20, 30)]
    codes += [f"00:00:00:0{k}.000" for k in range(10)]
    for k, code in enumerate(codes):
        lines[k + 1] = ",".join([code, *lines[k + 1].split(",")[1:]])
    lines[2] = f"{codes[1]},0"
    path.write_text("\n".join(lines))
    seen = np.array([0, *range(2, 20)])
    np.testing.assert_allclose(read_livelink(path).times, seen / 30, atol=1e-6)


def test_sound_shorter_than_the_curves_is_refused(tmp_path):
    take, sound = write_take(tmp_path / "a.csv"), write_sound(tmp_path / "a.wav", 1.5)
    with pytest.raises(InputError, match=r"expected at least the 3.0 s of a.csv, got 1.5 s"):
        CreateSession(folder=tmp_path / "s", audio=sound, livelink=take).run()
    assert not (tmp_path / "s").exists()
    with pytest.raises(InputError, match="cut the take"):
        list(real.own_takes(tmp_path, (0,)))


def test_unreadable_files_are_refused(tmp_path):
    write_take(tmp_path / "me.csv")
    (tmp_path / "me.wav").write_text("no sound")
    with pytest.raises(InputError, match=r"me.wav: expected a sound file, got something else"):
        list(real.own_takes(tmp_path, (0,)))
    (tmp_path / "grid").mkdir()
    (tmp_path / "grid" / "labels.npz").write_text("no arrays")
    with pytest.raises(InputError, match=r"labels.npz: expected the arrays weights, names"):
        mocap.grid_speakers(tmp_path / "grid")
    with pytest.raises(InputError, match=r"expected \*/labels.npz or facegood"):
        build.plans(build.Config(subjects=1, mocap=tmp_path / "grid"))


def test_neither_sound_nor_take_is_refused(tmp_path):
    with pytest.raises(InputError, match="--audio or --livelink"):
        CreateSession(folder=tmp_path / "s").run()


def test_own_takes_become_a_subject(tmp_path):
    write_take(tmp_path / "me.csv")
    write_sound(tmp_path / "me.wav", 3.2)
    (take,) = real.own_takes(tmp_path, (0,))
    assert take.clip.truth == "tracked" and take.clip.voice == "own-me"
    assert take.clip.num_frames == 96


@pytest.mark.slow
def test_grid_clips_get_their_phones_where_they_are_said(tmp_path):
    said = speak_flite("bin blue at f two now", "slt")
    sound = np.concatenate([np.zeros(24_000, np.float32), said.audio, np.zeros(24_000, np.float32)])
    (tmp_path / "audio").mkdir()
    for clip in ("bbaf1n", "bbaf2n"):
        soundfile.write(tmp_path / "audio" / f"{clip}.ogg", sound, 48_000)
    starts = [round(25_000 * (0.5 + len(said.audio) / 48_000 * k / 6)) for k in range(7)]
    words = ["bin", "blue", "at", "f", "two", "now"]
    rows = [f"{a} {b} {w}" for a, b, w in zip(starts, starts[1:], words, strict=False)]
    lines = [f"{clip}\t{' ; '.join(rows)} ;\n" for clip in ("bbaf1n", "bbaf2n")]
    (tmp_path / "alignments.tsv").write_text("clip\twords\n" + "".join(lines))
    frames = len(sound) // 1920  # 25 FPS
    moved = speech_curves(
        [Phone(p.name, p.start + 0.5, p.end + 0.5) for p in said.phones], sound, Style(),
        np.random.default_rng(0),
    ).rig  # fmt: skip
    at = np.arange(frames) * 30 / 25
    jaw = np.interp(at, np.arange(len(moved)), moved[:, JAW_OPEN])
    weights = jaw[None, :, None].repeat(2, 0).astype(np.float16)
    np.savez(
        tmp_path / "labels.npz", weights=weights, names=np.array(["jawOpen"]),
        clips=np.array(["bbaf1n", "bbaf2n"]), fps=np.array(25),
    )  # fmt: skip
    (taken,) = mocap.grid_takes(tmp_path, "s1", None, (0,), last=1)
    phones = [PHONES[i] for i in taken.clip.phones if i > 0]
    assert phones[0] == "b" and phones[-1] == "aw" and "f" in phones
    b = np.flatnonzero(taken.clip.phones == PHONES.index("b"))
    true = [p.start + 0.5 for p in said.phones if p.name == "b"]
    assert abs(b[0] / 30 - true[0]) < 0.1
