"""Rooms on a Janus server of our own, in a network namespace: libnice leaves loopback out."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from app.call.rooms.janus_server import (
    ServerSettings,
    admin_key,
    room_invite,
    token,
    write_configuration,
)
from app.call.wire.invite import parse
from sensors.types import InputError

SCENE = Path(__file__).with_name("room_scene.py")
KEY = "0123456789abcdef" * 2


def test_three_people_meet_lose_the_server_and_are_back() -> None:
    """Janus and namespaces are part of the set-up (make setup): without them this is a failure."""
    assert shutil.which("janus"), "run: sudo apt-get install janus"
    command = ["unshare", "--net", "--map-root-user", sys.executable, str(SCENE), "3", "3"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr[-2000:]
    found = json.loads(done.stdout.splitlines()[-1])
    assert "secret" in found["refused"]["wrong secret"]
    assert "let in" in found["refused"]["no token"]
    for reports in found["reports"]:
        assert len(reports) == 2 and all(r["packets"] > 20 and not r["refused"] for r in reports)


def test_the_configuration_holds_nothing_of_a_call_and_is_private(tmp_path: Path) -> None:
    path = write_configuration(tmp_path / "janus", ServerSettings(key=KEY))
    texts = [p.read_text() for p in path.parent.iterdir()]
    assert KEY not in "".join(texts) and admin_key(KEY) in "".join(texts)
    assert all(p.stat().st_mode & 0o077 == 0 for p in path.parent.iterdir())


def test_tokens_end_and_differ_by_key() -> None:
    assert token(KEY, 1000).startswith("44200,janus,janus.plugin.videoroom:")
    assert token(KEY, 1000) != token(KEY[::-1], 1000)


def test_an_invite_to_a_room_is_whole_or_refused() -> None:
    server = "wss://example.org:8989#" + "ab" * 32
    invite = room_invite(server, "choir", bytes(16), KEY, 1000)
    assert parse(str(invite)) == invite and invite.fingerprint == b"\xab" * 32
    for bad in (("http://x:1", "choir", KEY), (server, "a b", KEY), (server, "choir", "12")):
        with pytest.raises(InputError, match="livedrive call server"):
            room_invite(bad[0], bad[1], bytes(16), bad[2], 1000)
