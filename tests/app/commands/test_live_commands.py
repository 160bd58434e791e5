"""`livedrive run` and `record` as a user meets them: live = replay, Ctrl-C, bad words."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sensors.session.recording import Recording

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[3]
SMOKE = f"session:{ROOT / 'recordings' / 'smoke'}"
DEMO = f"session:{ROOT / 'recordings' / 'demo'}"
START = [sys.executable, "-c", "from app.main import main; main()"]


def streams(timeline: Path) -> set[str]:
    """What has been recorded so far; the last line may not be whole yet."""
    whole = timeline.read_text().rpartition("\n")[0]
    return {json.loads(line)["stream"] for line in whole.splitlines()}


def test_a_live_run_is_recorded_and_replays_to_the_same_codes(
    livedrive: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    words = ["--headless", "--mic", "none", "--eyes", SMOKE, "--head", DEMO, "--seconds", "1.5"]
    words += ["--record", "tape", "--motion", "live.npz", "--report", "live.json"]
    done = livedrive("run", *words)
    assert done.returncode == 0, done.stderr
    report = json.loads((tmp_path / "live.json").read_text())
    assert report["frames"] >= 44
    assert report["frames_with_gap"] == report["frames"]
    assert report["sensors"][SMOKE]["pictures"] > 0
    assert "microphone" not in report["sensors"]
    head = report["sensors"]["head"]
    assert head["name"] == DEMO and head["problem"] == ""
    assert head["poses"] > 30 and head["bad"] == head["jumps"] == head["flooded"] == 0
    told = json.loads(livedrive("session", "info", "tape").stdout)
    assert told["head_poses"] > 30
    again = livedrive("replay", "tape", "--motion", "again.npz")
    assert again.returncode == 0, again.stderr
    live, replayed = np.load(tmp_path / "live.npz"), np.load(tmp_path / "again.npz")
    assert len(live["t_ns"]) == report["frames"]
    for name in live.files:
        np.testing.assert_array_equal(live[name], replayed[name], name)


@pytest.mark.parametrize("sent", ["SIGINT", "SIGHUP"])
def test_ctrl_c_or_a_closed_terminal_finishes_the_recording(tmp_path: Path, sent: str) -> None:
    child = subprocess.Popen(
        [*START, "record", "tape", "--mic", "none", "--eyes", SMOKE],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    timeline, deadline = tmp_path / "tape" / "timeline.jsonl", time.monotonic() + 60
    # The cameras may begin long after the sound.
    while not (timeline.is_file() and {"eye_left", "eye_right"} <= streams(timeline)):
        assert time.monotonic() < deadline and child.poll() is None
        time.sleep(0.02)
    child.send_signal(getattr(signal, sent))
    out, err = child.communicate(timeout=60)
    assert child.returncode == 130, err
    assert "next: livedrive replay tape" in out
    assert "Traceback" not in err
    with Recording(tmp_path / "tape") as recording:
        assert recording.card["closed"]
        assert "repaired" not in recording.card
        assert len(recording.eyes) == 2


def test_a_recording_that_cannot_be_written_leaves_the_drive_alone(
    livedrive: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("")
    words = ["--headless", "--mic", "none", "--seconds", "0.5", "--record", "file/tape"]
    done = livedrive("run", *words)
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("driving goes on") == 1
    assert re.match(r"(1[4-9]|2\d) frames", done.stdout)


@pytest.mark.skipif(sys.platform == "win32", reason="has no limit for the size of a file")
def test_a_file_that_a_full_disk_has_ended_is_not_called_written(
    livedrive: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Red before: "wrote m.npz", where there was an old one or none."""
    import resource

    monkeypatch.chdir(tmp_path)
    words = ["--headless", "--mic", "none", "--seconds", "0.5", "--motion", "m.npz"]
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (40_000, before[1]))
    try:
        done = livedrive("run", *words, "--arkit", "a.csv", "--report", "r.json")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert done.returncode == 0 and "motion: File too large; it ends here" in done.stderr
    assert "a.csv" in done.stdout and "m.npz" not in done.stdout
    assert json.loads((tmp_path / "r.json").read_text())["lost"] == ["m.npz"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["run", "--headless", "--mic", "none", "--eyes", "nonsense"], "--eyes"),
        (["run", "--headless", "--mic", "no such one"], "livedrive devices"),
        (["record", ".", "--mic", "none"], "new or empty"),
    ],
)
def test_bad_words_end_in_one_line(
    livedrive: Any,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    words: list[str],
    said: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("")
    done = livedrive(*words)
    assert done.returncode == 2
    line = done.stderr.strip().splitlines()[-1]
    assert said in line
    assert "Traceback" not in done.stderr


def test_devices_say_what_to_type(livedrive: Any) -> None:
    done = livedrive("devices")
    assert done.returncode == 0, done.stderr
    assert "--eyes http://" in done.stdout
    assert "--head vmc://" in done.stdout
