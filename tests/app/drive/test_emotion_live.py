"""`--emotion` as a user meets it, with the shipped weights: live = replay, changed from outside."""

import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_live_commands import SMOKE

from app.drive.emotion_port import ADDRESS

pytestmark = pytest.mark.slow


def test_a_live_emotion_is_recorded_replayed_and_can_be_taken_back(
    livedrive: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    words = [
        "--headless",
        "--mic",
        "none",
        "--eyes",
        SMOKE,
        "--seconds",
        "1",
        "--condition",
        "gaze",
    ]
    words += ["--emotion", "sad:0.8", "--record", "tape", "--motion", "live.npz"]
    done = livedrive("run", *words)
    assert done.returncode == 0, done.stderr
    lines = (tmp_path / "tape" / "timeline.jsonl").read_text().splitlines()
    said = [fields for line in lines if (fields := json.loads(line))["stream"] == "emotion"]
    assert [fields["words"] for fields in said] == ["sad:0.8"]
    motions: dict[str, np.ndarray] = {}
    for name, more in (("same", []), ("calm", ["--emotion", "neutral"])):
        out = [*more, "--condition", "gaze", "--motion", f"{name}.npz"]
        done = livedrive("replay", "tape", *out)
        assert done.returncode == 0, done.stderr
        motions[name] = np.load(tmp_path / f"{name}.npz")["expression"]
    live = np.load(tmp_path / "live.npz")["expression"]
    np.testing.assert_array_equal(live, motions["same"])
    assert np.abs(live - motions["calm"])[15:].max() > 0.05


def test_a_message_changes_the_emotion_of_a_run(tmp_path: Path) -> None:
    import socket

    from pythonosc.udp_client import SimpleUDPClient

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    words = ["run", "--headless", "--mic", "none", "--seconds", "1", "--record", "tape"]
    child = subprocess.Popen(
        [sys.executable, "-c", "from app.main import main; main()", *words, "--listen", str(port)],
        cwd=tmp_path,
        env={"PYTHONPATH": str(Path(__file__).parents[3]), "PATH": "/usr/bin:/bin", "HOME": "/tmp"},
        stdout=subprocess.DEVNULL,
    )
    client = SimpleUDPClient("127.0.0.1", port)
    while child.poll() is None:
        client.send_message(ADDRESS, ["happy", 0.5])
        time.sleep(0.1)
    assert child.returncode == 0
    timeline = (tmp_path / "tape" / "timeline.jsonl").read_text()
    assert timeline.count('"words":"happy:0.5"') == 1


@pytest.mark.parametrize(
    ("words", "hint"), [("hapy", "did you mean happy"), ("happy:3", "0..1"), ("proud", "--clip")]
)
def test_bad_words_are_said_in_one_line(livedrive: Any, words: str, hint: str) -> None:
    done = livedrive("replay", SMOKE.removeprefix("session:"), "--emotion", words)
    assert done.returncode == 2 and hint in done.stderr and done.stderr.count("\n") == 1
