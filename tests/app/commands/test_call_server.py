"""`call server`: its Janus ends when it does, however that is."""

import shutil
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import psutil
import pytest

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not shutil.which("janus"), reason="no Janus here"),
]

PATIENCE_S = 60.0


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_no_server_is_left(tmp_path: Path, number: signal.Signals) -> None:
    """Red before: a killed command left Janus with its port; `kill` was told as a failure."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    words = ["call", "server", str(tmp_path / "room"), "--port", str(port)]
    code = "from app.main import main; main()"
    with subprocess.Popen(
        [sys.executable, "-c", code, *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as command:
        assert command.stdout and "livedrive call host" in command.stdout.readline()
        (janus,) = psutil.Process(command.pid).children()
        end = time.monotonic() + PATIENCE_S
        while janus.name() != "janus" or not listens(port):
            assert time.monotonic() < end, "Janus did not start"
            time.sleep(0.1)
        command.send_signal(number)
        _, said = command.communicate(timeout=PATIENCE_S)
    janus.wait(PATIENCE_S)
    assert not list(tmp_path.rglob("core*"))
    if number == signal.SIGKILL:
        assert command.returncode == -signal.SIGKILL
    else:
        assert command.returncode == 130 and said == "livedrive: stopped\n"


def test_a_room_on_it_is_opened_and_its_invite_told(livedrive: Any, tmp_path: Path) -> None:
    """The invite comes once the server has let the host in."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    start = [sys.executable, "-c", "from app.main import main; main()", "call"]
    host = ["call", "host", "--room", "choir", "--key", str(tmp_path / "room" / "key")]
    host += ["--server", f"ws://127.0.0.1:{port}", "--headless", "--seconds", "0.5"]
    for device in ("--mic", "--speaker"):
        host += [device, "none"]
    with subprocess.Popen(
        [*start, "server", str(tmp_path / "room"), "--port", str(port)]
    ) as server:
        try:
            end = time.monotonic() + PATIENCE_S
            while not listens(port):
                assert time.monotonic() < end, "Janus did not start"
                time.sleep(0.1)
            done = livedrive(*host)
        finally:
            server.terminate()
    assert done.stdout.startswith("invite: livedrive") and done.returncode == 0, done.stderr


def listens(port: int) -> bool:
    with socket.socket() as end:
        return end.connect_ex(("127.0.0.1", port)) == 0
