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
RUN = [sys.executable, "-c", "from app.main import main; main()"]
RUN += ["run", "--headless", "--mic", "none", "--seconds"]
UPLOAD_S = "11"  # ONNX Runtime tries its first upload 8.5 s after it was loaded
ISOLATED = ["unshare", "--net", "--map-root-user"]
COUNTERS = {("Ip", "OutNoRoutes"), ("Udp", "OutDatagrams"), ("Tcp", "ActiveOpens")}


def home(tmp_path: Path) -> dict[str, str]:
    """An environment in which everything that is kept for a user lies below `tmp_path`."""
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("XDG_", "ORT_"))}
    (tmp_path / "home").mkdir()
    return kept | {"HOME": str(tmp_path / "home"), "PYTHONPATH": str(ROOT)}


def left_in(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


def test_a_run_leaves_nothing_in_the_users_home(tmp_path: Path) -> None:
    subprocess.run([*RUN, "0.5"], cwd=tmp_path, env=home(tmp_path), check=True, timeout=120)
    assert left_in(tmp_path) == ["home"]


def isolated() -> bool:
    if not shutil.which("unshare"):
        return False
    return subprocess.run([*ISOLATED, "true"], capture_output=True).returncode == 0


def attempts(words: list[str], env: dict[str, str], cwd: Path) -> dict[tuple[str, str], int]:
    """What the kernel counted while a command ran in a network that has no way out."""
    script = '"$@" >&2 && cat /proc/net/snmp'
    done = subprocess.run(
        [*ISOLATED, "sh", "-c", script, "sh", *words],
        env=env, cwd=cwd, capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    rows = [line.split() for line in done.stdout.splitlines()]
    counts = {
        (names[0].rstrip(":"), name): int(value)
        for names, values in zip(rows[::2], rows[1::2], strict=True)
        for name, value in zip(names[1:], values[1:], strict=True)
    }
    return {key: counts[key] for key in COUNTERS}


@pytest.mark.skipif(not isolated(), reason="needs a user namespace: unshare --net")
def test_a_run_resolves_and_connects_nowhere(tmp_path: Path) -> None:
    env = home(tmp_path)
    look_up = "import socket; socket.socket(type=socket.SOCK_DGRAM).connect_ex(('192.0.2.1', 53))"
    counted = attempts([sys.executable, "-c", look_up], env, tmp_path)
    assert sum(counted.values()) == 1  # so a zero means something
    assert attempts([*RUN, UPLOAD_S], env, tmp_path) == dict.fromkeys(COUNTERS, 0)
