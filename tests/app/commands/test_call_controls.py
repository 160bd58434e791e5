"""Controls of a call whose end has no window: typed, sent by a program, and shown at the page."""

import json
import os
import socket
import subprocess
import sys
import time
import urllib.request
from pathlib import Path
from typing import Any

import pytest
from pythonosc.osc_message_builder import OscMessageBuilder

ROOT = Path(__file__).parents[3]
START = [sys.executable, "-c", "from app.main import main; main()"]
CALL = [
    "call",
    "host",
    "--headless",
    "--mic",
    "none",
    "--speaker",
    "none",
    "--address",
    "127.0.0.1",
]
PATIENCE_S = 60


def free_port(kind: socket.SocketKind) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def controls(port: int) -> dict[str, Any]:
    try:
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/offers") as answer:
            return json.load(answer)["controls"]
    except OSError:
        return {}


@pytest.mark.slow
def test_what_is_typed_or_sent_is_shown_at_the_page() -> None:
    """Red before: the page went on showing no emotion, and "Mute" of somebody who was muted."""
    web, listen = free_port(socket.SOCK_STREAM), free_port(socket.SOCK_DGRAM)
    child = subprocess.Popen(
        [*START, *CALL, "--condition", "gaze", "--web", str(web), "--listen", str(listen)],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert child.stdin and child.stdout
    happy = OscMessageBuilder("/livedrive/emotion")
    happy.add_arg("happy:0.7")
    try:
        assert child.stdout.readline()
        child.stdin.write("m\n")
        child.stdin.flush()
        wanted, deadline = {"emotion": "happy:0.7", "muted": True}, time.monotonic() + PATIENCE_S
        while not wanted.items() <= (now := controls(web)).items():
            assert child.poll() is None and time.monotonic() < deadline, now
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
                sender.sendto(happy.build().dgram, ("127.0.0.1", listen))
            time.sleep(0.2)
        child.communicate("q\n", timeout=PATIENCE_S)
        assert child.returncode == 0
    finally:
        child.kill()
        child.wait()
