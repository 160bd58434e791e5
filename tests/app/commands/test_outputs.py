"""What will be written is judged before the work: a wrong name costs nothing, no file is lost."""

import shutil
import signal
import socket
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest
import soundfile

from app.commands.meet.server import Server
from app.commands.replay import Replay
from app.commands.session import CreateSession
from app.main import main
from app.terminal import outputs
from sensors.session.recording import RecordingWriter
from sensors.types import AudioPacket

SMOKE = Path(__file__).parents[3] / "recordings" / "smoke"


def told(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """What the command says where it ends with status 2."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["livedrive", *words])
        with pytest.raises(SystemExit) as end:
            main()
    assert end.value.code == 2
    return capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("avatar show ada --picture {}/a.xyz", ".png, .jpg, .jpeg, got 'a.xyz'"),
        ("avatar show ada --picture {}/a.jpg --background transparent", "a PNG to write"),
        ("avatar show ada --picture {}/none/a.png", "mkdir -p"),
        ("avatar show {0}/a.ply --picture {0}/a.jpg --sheet portrait", "a.ply; leave --sheet out"),
        ("avatar show {0}/a.ply --picture {0}/a.jpg --light rim", "leave --light out"),
        ("avatar show {0}/a.PLY --picture {0}/a.jpg --light rim", "leave --light out"),
        ("avatar show ada --picture {}/a.jpg --sheet lights --light rim", "leave --light out"),
        ("avatar show ada --picture {}/a.jpg --sheet eyes --traverse", "leave --sheet out"),
        ("avatar export ada {}/a.glb", ".ply, got 'a.glb'"),
        ("avatar turn ada {}/none/a.mp4", "mkdir -p"),
        ("replay recordings/smoke --arkit {}/a.npz", ".csv, got 'a.npz'"),
        ("replay recordings/smoke --report {}/none/a.json", "mkdir -p"),
        ("bench --report {}/none/a.json", "mkdir -p"),
        ("replay recordings/smoke --motion {}/a.txt", ".npz, got 'a.txt'; try a.npz"),
        ("replay recordings/smoke --report {}/a.txt", ".json, got 'a.txt'; try a.json"),
        ("bench --report {}/a.txt", ".json, got 'a.txt'"),
        ("eval head --report {}/a.txt", ".json, got 'a.txt'"),
        ("call test --report {}/a.txt", ".json, got 'a.txt'"),
        ("capture statistics {} --report {}/a.txt", ".json, got 'a.txt'"),
        ("eval head --plot {}/a.xyz", "got 'a.xyz'"),
        ("eval ab {0} {0} --out {0}/a.txt", ".html, got 'a.txt'"),
        ("capture inspect {} --picture {}/a.xyz", "got 'a.xyz'"),
    ],
)
def test_a_wrong_name_is_refused_before_the_work(
    words: str, expected: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Red before: tracebacks of Pillow and Matplotlib after it, reports lost, a.npz full of text.

    A file of that name stays as it was."""
    for name in ("a.xyz", "a.jpg", "a.glb", "a.npz", "a.txt"):
        (tmp_path / name).write_text("mine")
    assert expected in told(words.replace("{}", str(tmp_path)).format(tmp_path).split(), capsys)
    assert {path.read_text() for path in tmp_path.iterdir()} == {"mine"}


@pytest.mark.parametrize(
    ("words", "one", "other"),
    [
        ("--motion {}/a.npz --report {}/a.npz", "--report", "--motion"),
        ("--video {}/a.mp4 --pictures {}/link/a.mp4", "--pictures", "--video"),
    ],
)
def test_two_outputs_have_two_names(
    words: str, one: str, other: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Red before: the first was lost, and both were told as written."""
    (tmp_path / "link").symlink_to(tmp_path)
    (tmp_path / "a.npz").write_text("mine")
    said = told(f"replay {SMOKE} {words}".replace("{}", str(tmp_path)).split(), capsys)
    assert f"{one}: expected another name than that of {other}, got" in said
    assert (tmp_path / "a.npz").read_text() == "mine"


def test_folders_of_different_files_may_be_one(tmp_path: Path) -> None:
    outputs.check_distinct({}, {"--pictures": tmp_path, "--ply": tmp_path})


@pytest.mark.parametrize(
    "words",
    [
        "eval ab . . --seed -1",
        "bench fuzz --seed -1",
        "bench fuzz --num 0",
        "capture data --seed -1",
        "capture data --processes 0",
    ],
)
def test_a_number_out_of_range_is_refused(words: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Red before: tracebacks of NumPy and of multiprocessing."""
    assert "or more, got" in told(words.split(), capsys)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("call host --port 99999 --headless --mic none", "expected 0..65535"),
        ("call server DIR --port 99999", "expected 0..65535"),
        ("call host --ice bogus --headless --mic none", "expected stun:HOST:PORT"),
        ("call host --address nö..such --headless --mic none", "leave it away"),
        ("call server DIR --media 1", "try --media 20000-20400"),
        ("call server DIR --media 400-300", "try --media 20000-20400"),
        ("call server DIR --host nö..such", "choose an address of this machine"),
        ("run --mic none --headless --eyes foo:1", "got 'foo:1'; see: livedrive devices"),
        ("run --mic none --headless --eyes uvc:0#turn=45", "got 'turn=45'; try #eye=left"),
        ("run --mic none --headless --head bogus", "got 'bogus'; try --head auto"),
        ("session create none --audio a.wav --codec h265", "--codec"),
        ("eval eyes --clips 0", "--real FOLDER"),
        ("eval eyes --clips 2 --seconds 0", "1 s or more"),
        ("eval eyes --clips 2 --seconds 0.01", "1 s or more"),  # red before: a traceback
    ],
)
def test_a_wrong_word_is_told_at_once(
    words: str, expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Red before: a traceback of the call's process, a server that nobody reached, a call without
    the servers that were asked for, an invite that nobody could read, an evaluation of nothing that
    succeeded."""
    assert expected in told(words.split(), capsys)


def test_a_server_needs_its_port(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Red before: Janus went on without it, and the line to type next led nowhere."""
    with socket.create_server(("127.0.0.1", 0)) as held:
        port = held.getsockname()[1]
        said = told(f"call server {tmp_path} --port {port}".split(), capsys)
    assert "choose another port" in said and not any(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("host", "address"), [("::1", ""), ("[::1]", ""), ("::1", "2001:db8::7"), ("::1", "[::7]")]
)
def test_a_server_tells_an_address_that_a_call_reads(
    host: str,
    address: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Red before: in brackets the address was unknown, and without them the line to type was none
    that `call host --server` takes."""
    given = list[str]()

    def start(folder: Path, settings: Any) -> Any:  # noqa: ARG001
        given.append(settings.host)
        return SimpleNamespace(wait=lambda: 1, kill=lambda: None, terminate=lambda: None)

    monkeypatch.setattr("app.call.rooms.janus_server.start", start)
    monkeypatch.setattr("app.commands.meet.server._check_free", lambda *_: None)
    monkeypatch.setattr(signal, "signal", lambda *_: None)
    with pytest.raises(OSError, match="Janus ended"):
        Server(folder=tmp_path, host=host, address=address).run()
    line = capsys.readouterr().out.split("--server ")[1].strip().strip("'")
    named = address.strip("[]") or "::1"
    assert given == ["::1"] and urlsplit(line).hostname == named and urlsplit(line).port == 8188


def test_nothing_is_measured_on_no_frames(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Red before: `bench` passed every threshold, `eval head` ended in a traceback."""
    soundfile.write(tmp_path / "a.wav", np.zeros(100, np.float32), 48_000)
    CreateSession(folder=tmp_path / "s", audio=tmp_path / "a.wav").run()
    assert "at least one frame" in told(f"bench --session {tmp_path}/s".split(), capsys)
    assert "at least one frame" in told(f"eval head --session {tmp_path}/s".split(), capsys)
    soundfile.write(tmp_path / "b.wav", np.zeros(1600, np.float32), 48_000)
    CreateSession(folder=tmp_path / "b", audio=tmp_path / "b.wav").run()
    assert "1 s or more" in told(f"eval head --session {tmp_path}/b".split(), capsys)


def test_an_empty_variable_names_no_folder(capsys: pytest.CaptureFixture[str]) -> None:
    """Red before: pictures were written into the current folder."""
    assert "--pictures: expected a value, got an empty" in told(
        ["replay", "s", "--pictures", ""], capsys
    )


def test_a_bench_takes_a_time(capsys: pytest.CaptureFixture[str]) -> None:
    assert "expected more than 0" in told(["bench", "web", "--minutes", "nan"], capsys)


@pytest.mark.parametrize(
    "words", ["replay {}", "session info {}", "session create {}/x --audio {}"]
)
def test_a_file_is_no_folder(
    words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Red before: status 1, "what was written before it is kept"."""
    (tmp_path / "file").write_text("mine")
    told(words.replace("{}", str(tmp_path / "file")).split(), capsys)


def test_a_folder_is_no_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Red before: status 1, "what was written before it is kept"."""
    said = told(["eval", "ab", "--count", str(tmp_path)], capsys)
    assert "expected a file, got a folder" in said


def test_a_replay_replaces_no_file_of_its_session(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Red before: the video of the head took the place of an eye that was being read."""
    shutil.copytree(SMOKE, tmp_path / "s")
    told(f"replay {tmp_path}/s --video {tmp_path}/s/eye_left.mkv".split(), capsys)
    assert (tmp_path / "s" / "eye_left.mkv").read_bytes() == (SMOKE / "eye_left.mkv").read_bytes()


def test_lost_eye_pictures_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Red before: codes of another session, and not a word."""
    shutil.copytree(SMOKE, tmp_path / "s")
    eye = tmp_path / "s" / "eye_left.mkv"
    eye.write_bytes(eye.read_bytes()[:60_000])
    Replay(session=tmp_path / "s", condition="eyes").run()
    assert "eye pictures are missing" in capsys.readouterr().err


def test_a_sound_shorter_than_a_frame_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    soundfile.write(tmp_path / "a.wav", np.zeros(100, np.float32), 48_000)
    CreateSession(folder=tmp_path / "s", audio=tmp_path / "a.wav").run()
    said = capsys.readouterr().out
    assert "shorter than one frame" in said and "next:" not in said


@pytest.mark.parametrize("samples", [0, 480])
@pytest.mark.parametrize(
    "words", ["--video {}.mp4", "--motion {}.npz", "--arkit {}.csv --report {}.json"]
)
def test_a_replay_of_no_frames_leaves_what_was_there(
    samples: int, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Red before: "0 frames", status 0, and older files of no bytes."""
    with RecordingWriter(tmp_path / "s", created="") as writer:
        if samples:
            writer.append(AudioPacket(0, 0, np.zeros(samples, np.float32)))
    outputs = [tmp_path / f"out.{suffix}" for suffix in ("mp4", "npz", "csv", "json")]
    for path in outputs:
        path.write_text("mine")
    command = f"replay {tmp_path}/s {words}".replace("{}", f"{tmp_path}/out")
    said = told(command.split(), capsys)
    assert f"at least one frame of sound (1600 samples), got {samples}" in said
    assert {path.read_text() for path in outputs} == {"mine"}


def test_a_folder_takes_the_place_of_no_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Red before: status 1."""
    (tmp_path / "file").write_text("mine")
    words = ["replay", str(SMOKE), "--pictures", str(tmp_path / "file"), "--size", "64"]
    assert "got a file; choose another" in told(words, capsys)
    assert (tmp_path / "file").read_text() == "mine"


@pytest.mark.parametrize("option", ["--pictures", "--ply", "--gltf"])
def test_nothing_is_written_into_the_session_itself(
    option: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Red before: its folder, which `session info` counts and people share, filled with them."""
    shutil.copytree(SMOKE, tmp_path / "s")
    (tmp_path / "link").symlink_to(tmp_path / "s")
    for into in ("s", "link"):
        words = f"replay {tmp_path}/s {option} {tmp_path}/{into}"
        assert "expected another place than the session's own, got" in told(words.split(), capsys)
    assert {p.name for p in (tmp_path / "s").iterdir()} == {p.name for p in SMOKE.iterdir()}
