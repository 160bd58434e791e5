"""`livedrive session` as a user meets it: how far it is, and what to type next."""

import errno
import io
import shlex
import shutil
from pathlib import Path
from types import SimpleNamespace

import av
import numpy as np
import pytest
import soundfile

from app.capture import session_motion
from app.command_line import run
from app.commands.session import CreateSession, ExportSession, SessionInfo
from sensors.session.recording import RecordingWriter
from sensors.types import InputError

SMOKE = Path(__file__).parents[3] / "recordings" / "smoke"


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.slow
def test_making_and_exporting_tell_how_far_they_are_and_what_comes_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Red before: nothing for 49 s, and a next line that a folder with a space broke."""
    folder = tmp_path / "my own session"
    soundfile.write(tmp_path / "a.wav", np.zeros(48_000, np.float32), 48_000)
    monkeypatch.setattr("sys.stderr", shown := Terminal())
    CreateSession(folder=folder, audio=tmp_path / "a.wav").run()
    ExportSession(folder=folder, out=tmp_path / "out.mkv").run()
    assert "writing: 1 s of sound" in shown.getvalue()
    assert "exporting: 1 s of sound" in shown.getvalue()
    told = capsys.readouterr().out
    (line,) = [line for line in told.splitlines() if line.startswith("next: ")]
    assert shlex.split(line)[1:4] == ["livedrive", "replay", str(folder)]
    shutil.rmtree(folder)


def test_an_export_says_which_pictures_are_missing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(SMOKE, tmp_path / "s")
    eye = tmp_path / "s" / "eye_left.mkv"
    eye.write_bytes(eye.read_bytes()[:60_000])
    ExportSession(folder=tmp_path / "s", out=tmp_path / "out.mkv").run()
    assert "eye pictures are missing; restore the eye videos" in capsys.readouterr().out


def test_names_are_told_as_they_are_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Red before: \\u00fc, which nobody finds again."""
    shutil.copytree(SMOKE, tmp_path / "Grüße")
    SessionInfo(folder=tmp_path / "Grüße").run()
    ExportSession(folder=tmp_path / "Grüße", out=tmp_path / "für.mkv").run()
    told = capsys.readouterr().out
    assert "Grüße" in told and "für.mkv" in told


def test_a_session_of_nothing_is_told_what_to_type(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="try --audio x.wav"):
        CreateSession(folder=tmp_path / "s").run()


@pytest.mark.parametrize("words", ["expected at least the 10.0 s", ""])
def test_the_film_of_a_take_is_as_long_as_its_curves(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: str
) -> None:
    """Live Link Face writes a .mov beside its CSV. Red before: what was longer was cut, silently;
    of a .raw sound nothing but a traceback came."""
    take = SimpleNamespace(times=np.array([0.0, 10.0]))
    monkeypatch.setattr("encoder.capture.subjects.livelink.read_livelink", lambda _: take)
    sound = tmp_path / ("a.mov" if words else "a.raw")
    if not words:
        sound.write_text("no sound")
        assert session_motion.read_take(tmp_path / "take.csv", sound) is take
        return
    with av.open(str(sound), "w") as container:
        stream = container.add_stream("pcm_s16le", rate=48_000, layout="mono")
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 48_000), np.int16), "s16", "mono")
        frame.sample_rate = 48_000
        container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    with pytest.raises(InputError, match=f"{words} of take.csv, got 1.0 s"):
        session_motion.read_take(tmp_path / "take.csv", sound)


@pytest.mark.parametrize(
    "words",
    [
        "session create {}/new --audio {}/a.wav",
        f"session export {SMOKE} {{}}/a.mkv",
        pytest.param("capture session {}/new --text Hi.", marks=pytest.mark.slow),
    ],
)
def test_a_full_disk_leaves_nothing_and_says_so(
    words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Red before: "what was written before it is kept", and nothing was; `capture` left half a
    session, closed as a whole one is."""

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    soundfile.write(tmp_path / "a.wav", np.zeros(4800, np.float32), 48_000)
    monkeypatch.setattr(RecordingWriter, "append", full)
    monkeypatch.setattr("sensors.session.export._export_frame", full)
    with pytest.raises(SystemExit) as ended:
        run(words.format(tmp_path, tmp_path).split())
    assert ended.value.code == 1 and [path.name for path in tmp_path.iterdir()] == ["a.wav"]
    assert "Traceback" not in (told := capsys.readouterr().err)
    line = told.splitlines()[-1]  # a bar may come before it
    assert "No space left" in line and "; nothing is kept; make room" in line
