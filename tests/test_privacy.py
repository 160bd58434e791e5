"""Nothing leaves the machine and nothing is left behind: a run asked for neither.

The commands run as their users run them, with a home of their own. Native libraries open sockets,
too, so it is the kernel that is asked: in a network namespace of its own it counts every attempt.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parent.parent
SESSION = str(ROOT / "recordings" / "smoke")
RUN = [sys.executable, "-c", "from app.main import main; main()"]
UPLOAD_S = "11"  # ONNX Runtime tries its first upload 8.5 s after it was loaded
ISOLATED = ["unshare", "--net", "--map-root-user"]
AWAY = ("Ip", "OutNoRoutes")  # to anywhere but this machine, there being no way out
COUNTERS = {AWAY, ("Udp", "OutDatagrams"), ("Tcp", "ActiveOpens")}
COMMANDS = {  # words, and what they are to write
    "run": (["run", "--headless", "--mic", "none", "--seconds", UPLOAD_S, "--web", "0"], []),
    "record": (
        ["record", "mine", "--mic", "none", "--seconds", "1"],
        ["mine", *(f"mine/{name}" for name in ("audio.wav", "session.json", "timeline.jsonl"))],
    ),
    "replay": (["replay", SESSION, "--motion", "out.npz"], ["out.npz"]),
    "call": (["call", "test", "--session", SESSION, "--lines", "0", "--seconds", "5"], []),
}


def home(tmp_path: Path) -> dict[str, str]:
    """An environment in which everything that is kept for a user lies below `tmp_path`."""
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("XDG_", "ORT_"))}
    (tmp_path / "home").mkdir()
    return kept | {"HOME": str(tmp_path / "home"), "PYTHONPATH": str(ROOT)}


def left_in(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


def isolated() -> bool:
    if not shutil.which("unshare"):
        return False
    return subprocess.run([*ISOLATED, "true"], capture_output=True).returncode == 0


def attempts(
    words: list[str], env: dict[str, str], cwd: Path, worst: int = 0
) -> dict[tuple[str, str], int]:
    """What the kernel counted while a command ran in a network that has no way out; its status is
    `worst` at most."""
    script = 'ip link set lo up && { "$@" >&2; test $? -le $0; } && cat /proc/net/snmp'
    done = subprocess.run(
        [*ISOLATED, "sh", "-c", script, str(worst), *words],
        env=env, cwd=cwd, capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    assert done.returncode == 0 and "Traceback" not in done.stderr, done.stderr
    rows = [line.split() for line in done.stdout.splitlines()]
    counts = {
        (names[0].rstrip(":"), name): int(value)
        for names, values in zip(rows[::2], rows[1::2], strict=True)
        for name, value in zip(names[1:], values[1:], strict=True)
    }
    return {key: counts[key] for key in COUNTERS}


@pytest.mark.skipif(not isolated(), reason="needs a user namespace: unshare --net")
@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_connects_nowhere_and_leaves_only_what_was_asked_for(
    tmp_path: Path, command: str
) -> None:
    words, written = COMMANDS[command]
    # a trial of calls also judges delays, which are not looked at here
    counted = attempts([*RUN, *words], home(tmp_path), tmp_path, worst=int(command == "call"))
    if command == "call":  # two ends on this machine talk to each other
        assert counted[AWAY] == 0
    else:
        assert counted == dict.fromkeys(COUNTERS, 0)
    assert left_in(tmp_path) == sorted(["home", *written])


@pytest.mark.skipif(not isolated(), reason="needs a user namespace: unshare --net")
def test_an_attempt_would_be_counted(tmp_path: Path) -> None:
    look_up = "import socket; socket.socket(type=socket.SOCK_DGRAM).connect_ex(('192.0.2.1', 53))"
    counted = attempts([sys.executable, "-c", look_up], home(tmp_path), tmp_path)
    assert counted[AWAY] == sum(counted.values()) == 1
