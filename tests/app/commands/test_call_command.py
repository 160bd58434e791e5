"""A call is opened or joined when all that was asked for is there, and not before."""

import asyncio
import json
import re
import socket
import sys
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from app.call.live import protocol
from app.call.live.protocol import CallSettings
from app.call.live.service import Service
from app.call.live.tape import CallTape
from app.call.rooms import janus_server
from app.call.rooms.direct import DirectGuest
from app.call.rooms.janus import JanusRoom
from app.call.rooms.room import Events, LineSettings
from app.call.table.seats import Seats
from app.call.trial.material import synthetic_material
from app.call.wire import ice
from app.call.wire.ice import IceServer
from app.call.wire.invite import Invite
from app.commands.meet.call import CallOptions, Host, Join
from app.commands.meet.server import Bridge, Server
from app.main import main
from app.process import child
from app.process.channel import pair
from sensors.clock import MonotonicClock
from sensors.live.recorder import LiveRecorder
from sensors.session.format import read_card
from sensors.types import AudioPacket, InputError

INVITE = f"livedrive://127.0.0.1:9/#{'A' * 22}.{'A' * 43}"
WORDS = {"host": ["call", "host"], "join": ["call", "join", INVITE]}
TOLD = re.compile(r"(--speaker|--mic|--send|avatar).*: expected.*(livedrive|try)|is it running")
MISSING = ["--mic", "--avatar", "--send"]


def refused(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    """The command ends with status 2 and one line, and has neither invited nor joined."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["livedrive", *words, "--headless", "--name", "ann"])
        patch.setattr("sensors.audio.portaudio.silence_native_messages", lambda: None)
        with pytest.raises(SystemExit) as ended:
            main()
    shown = capsys.readouterr()
    assert ended.value.code == 2 and shown.out == ""
    assert len(TOLD.findall(shown.err)) == 1, shown.err


@pytest.mark.parametrize("kind", WORDS)
@pytest.mark.parametrize("option", MISSING)
def test_what_is_missing_starts_no_call(
    kind: str, option: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Red before: the invite had been printed, or the other had been called."""

    def start(module: str, *_: object) -> Any:
        raise AssertionError(f"{module} was started")

    monkeypatch.setattr(child, "start", start)
    named = "vmc://no-such.invalid:1" if option == "--send" else "no such one"
    refused([*WORDS[kind], "--mic", "none", "--speaker", "none", option, named], capsys)


@pytest.mark.parametrize("data", [b"\x8a\xff" * 16, b"z" * 32], ids=["bytes", "text"])
@pytest.mark.parametrize("command", ["host", "server", "bridge"])
def test_a_file_that_is_no_key_is_refused(
    command: str, data: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Red before: a traceback, but for text of `host`, whose room was blamed."""
    monkeypatch.setattr(janus_server, "start", lambda *_: pytest.fail("it was started"))
    (key := tmp_path / "key").write_bytes(data)
    room = janus_server.room_invite("ws://127.0.0.1:9", "choir", bytes(16), "0" * 32, 0)
    commands = {
        "host": Host(room="choir", server="ws://127.0.0.1:9", key=key).settings_of_call,
        "server": Server(folder=tmp_path, port=0).run,
        "bridge": Bridge(invite=str(room), key=key, to="ws://127.0.0.1:9", to_key=key).run,
    }
    with pytest.raises(InputError, match=r"key of a server.* in .*key, got .*; give"):
        commands[command]()


@pytest.mark.slow
@pytest.mark.parametrize("kind", WORDS)
def test_a_missing_loudspeaker_is_told_once(kind: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Red before: the invite had been printed, and the run went on alone until Ctrl-C."""
    refused([*WORDS[kind], "--mic", "none", "--speaker", "no such one"], capsys)


def test_a_recording_that_nothing_can_hold_is_refused_at_the_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Red before: it was told once everybody had agreed, amid the call."""
    (tmp_path / "file").touch()
    monkeypatch.setattr(CallOptions, "live_drive_settings", lambda *_, **__: pytest.fail("passed"))
    with pytest.raises(InputError, match="--record: expected a folder to write into"):
        Join(invite=INVITE, record=tmp_path / "file" / "take").run()


@pytest.mark.slow
def test_the_report_of_a_call_tells_whether_it_was_recorded(livedrive: Any, tmp_path: Path) -> None:
    """Red before: only that of `run` did."""
    words = [*WORDS["host"], "--mic", "none", "--speaker", "none", "--headless", "--seconds", "1"]
    words += ["--address", "127.0.0.1", "--report", str(tmp_path / "report.json")]
    assert not livedrive(*words).returncode
    assert json.loads((tmp_path / "report.json").read_text())["recording"] == "none"


@pytest.mark.slow
def test_a_room_without_a_server_invites_nobody(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Red before: the invite had been printed."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        server = f"ws://127.0.0.1:{free.getsockname()[1]}"
    (tmp_path / "key").write_text("0" * 32)
    words = [*WORDS["host"], "--mic", "none", "--speaker", "none", "--key", str(tmp_path / "key")]
    refused([*words, "--room", "choir", "--server", server], capsys)


@pytest.mark.parametrize("settings", [{}, {"invite": INVITE}], ids=WORDS)
def test_nobody_is_let_in_without_a_loudspeaker(
    settings: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Red before: the call was open when the loudspeaker was looked for."""

    def missing(*_: object) -> None:
        raise InputError("--speaker: expected an output")

    async def opened(*_: object) -> None:
        raise AssertionError("the call was opened")

    monkeypatch.setattr("app.call.live.service.Speaker", missing)
    monkeypatch.setattr(Service, "_open_room", opened)
    ours, theirs = pair()
    seats = Seats()
    try:
        service = Service(theirs, seats, synthetic_material(3, 0).basis, MonotonicClock(), 0)
        with pytest.raises(InputError, match="--speaker"):
            asyncio.run(service.run(CallSettings(name="ann", avatar="ben", **settings)))
        assert protocol.INVITE not in {packet[:1] for packet in ours.waiting()}
    finally:
        ours.close()
        theirs.close()


def test_a_recording_is_finished_when_the_run_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Red before: the session stayed as it is while it is written."""
    link, live_run = Mock(), Mock()  # the others consent: what a Mock holds is true
    live_run.build = lambda tape, *_: tape
    live_run.open_recorder = lambda folder: LiveRecorder(folder, created="", devices={}, tell=print)

    def fails(tape: CallTape) -> None:
        tape.append(AudioPacket(0, 0, np.zeros(480, np.float32)))
        raise OSError(28, "disk full")

    monkeypatch.setattr("app.compose.call.open_call", lambda _: link)
    monkeypatch.setattr("app.compose.call.with_call", lambda parts, _: parts)
    monkeypatch.setattr("app.compose.live_run.LiveRun", lambda *_: live_run)
    monkeypatch.setattr("app.drive.loop.drive", fails)
    monkeypatch.setattr("app.commands.meet.keys.listen", Mock())
    monkeypatch.setattr(Join, "live_drive_settings", Mock())
    monkeypatch.setattr(Join, "live_settings", Mock())
    with pytest.raises(OSError, match="disk full"):
        Join(invite=INVITE, name="ann", record=tmp_path / "take").run()
    card = read_card(tmp_path / "take")
    assert card["closed"] and card["counts"] == {"audio": 480}
    link.close.assert_called_once()


@pytest.mark.parametrize("kind", ["direct", "room"])
def test_why_nobody_answers_is_told(kind: Any) -> None:
    """Red before: "ssl:<aiohttp.client_reqrep.Fingerprint ob", cut off before the reason."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    room = "choir" if kind == "room" else ""
    invite = Invite(kind, "127.0.0.1", port, bytes(16), bytes(32), room)
    events = Events(**dict.fromkeys(Events.__dataclass_fields__, print))

    async def run() -> None:
        if kind == "room":
            await JanusRoom(invite, "ann", events, LineSettings()).run()
        else:
            await DirectGuest(invite, events, LineSettings()).run()

    with pytest.raises(InputError, match="got: Connection refused;"):
        asyncio.run(run())


def test_a_name_that_others_would_cut_is_refused() -> None:
    """Red before: with one of some thousand letters nobody could be met, and no end said why."""
    assert Host(name="Zoë B.").name_of_own() == "Zoë B."
    for name in ("x" * 41, "Ann\n", "\x1b[2J"):
        with pytest.raises(InputError, match="--name: expected 40 characters"):
            Host(name=name).name_of_own()


def test_a_user_without_a_name_can_call(monkeypatch: pytest.MonkeyPatch) -> None:
    """Red before: a traceback, in a container whose user is but a number."""

    def nobody() -> str:
        raise KeyError("getpwuid(): uid not found: 1234")

    monkeypatch.setattr("getpass.getuser", nobody)
    assert Join(invite=INVITE).settings_of_call().name == "somebody"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("stun:example.org", IceServer("stun:example.org")),
        ("stuns:192.0.2.7:5349", IceServer("stuns:192.0.2.7:5349")),
        ("turn:ann:a/b+c=@example.org:3478", IceServer("turn:example.org:3478", "ann", "a/b+c=")),
        (
            "turns:ann:x:y@h:1?transport=tcp",
            IceServer("turns:h:1?transport=tcp", "ann", "x:y"),
        ),
    ],
)
def test_servers_for_the_line_are_read(text: str, expected: IceServer) -> None:
    """Red before: a password with a slash was refused, as most that are random have one."""
    assert ice.parse(text) == expected


@pytest.mark.parametrize(
    "text",
    ["turn:example.org:3478", "turn:ann@example.org", "stun:h:99999", "stun:[::1]:1", "stun:", "x"],
)
def test_what_is_no_server_is_refused(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Red before: the first five passed, and failed later in the call's process."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["livedrive", *WORDS["host"], "--ice", text])
        patch.setattr(CallOptions, "live_drive_settings", lambda *_, **__: sys.exit("passed"))
        with pytest.raises(SystemExit) as ended:
            main()
    assert ended.value.code == 2
    assert "turn:NAME:PASSWORD@HOST:PORT" in capsys.readouterr().err
