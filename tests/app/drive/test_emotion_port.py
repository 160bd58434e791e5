"""Emotions over the network: good words arrive, and no datagram ends or holds up a run."""

import logging
import os
import signal
import socket
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from pythonosc.osc_message_builder import OscMessageBuilder
from test_live_commands import ROOT, START

from app.drive.controls import Controls, Panel
from app.drive.emotion_port import ADDRESS, MAX_DATAGRAM, MAX_TOLD, OscPort, words_in
from sensors.osc import MAX_NESTING
from sensors.types import InputError

LABELS = ("happy", "sad", "angry")
LATIN_1 = b"/livedrive/emotion\0\0,s\0\0\xff\xfe\0\0"
BACKWARDS = b"#bundle\0" + bytes(7) + b"\1" + b"\xff\xff\xff\xfc"  # an element of -4 bytes


def check(words: str) -> None:
    if words.split(":")[0] not in LABELS:
        raise InputError(f"emotion: expected one of {LABELS}, got {words!r}")


@pytest.fixture
def port() -> Iterator[OscPort]:
    made = OscPort("127.0.0.1", 0, check)
    yield made
    made.close()


def message(address: str, *params: str | float | bool) -> bytes:
    builder = OscMessageBuilder(address)
    for param in params:
        builder.add_arg(param)
    return builder.build().dgram


def bundle(*elements: bytes) -> bytes:
    sized = (len(e).to_bytes(4, "big") + e for e in elements)
    return b"#bundle\0" + bytes(7) + b"\1" + b"".join(sized)


def nested(datagram: bytes, depth: int) -> bytes:
    for _ in range(depth):
        datagram = bundle(datagram)
    return datagram


def send(number: int, *datagrams: bytes) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for datagram in datagrams:
            sender.sendto(datagram, ("127.0.0.1", number))


def heard(port: OscPort) -> str:
    """The next words."""
    deadline = time.monotonic() + 40
    while not (picks := port.picks()):
        assert time.monotonic() < deadline, "heard nothing"
        time.sleep(0.005)
    return picks["emotion"]


def test_words_are_read_from_messages_and_bundles() -> None:
    assert words_in(message(ADDRESS, "happy:0.7")) == "happy:0.7"
    assert words_in(message(ADDRESS, "sad", 0.5)) == "sad:0.5"
    assert words_in(bundle(message(ADDRESS, "sad"), message(ADDRESS, "angry", 1))) == "angry:1"
    assert words_in(nested(message(ADDRESS, "sad"), MAX_NESTING)) == "sad"
    assert words_in(message("/other", "angry")) is None


HOSTILE = {
    "nothing": b"",
    "junk": b"junk",
    "no text": b"/livedrive/emotion\0\0,s\0\0",
    "Latin-1": LATIN_1,
    "Latin-1 types": b"/livedrive/emotion\0\0,\xff\0\0",
    "unknown type": b"/livedrive/emotion\0\0,Q\0\0",
    "arrays in arrays": b"/livedrive/emotion\0\0,".ljust(500, b"[").ljust(980, b"]") + bytes(4),
    "negative size": BACKWARDS,
    "size 0": bundle(b"", b""),
    "sizes of 0": b"#bundle\0" + bytes(1000),
    "too long": b"#bundle\0" + b"\xff" * 40,
    "too deep": nested(message(ADDRESS, "sad"), MAX_NESTING + 1),
    "as deep as it goes": nested(b"", 50),
    "2 KB of bundles": nested(b"", 100),
    "too big": message(ADDRESS, "x" * MAX_DATAGRAM),
    "escape sequence": message(ADDRESS, "\x1b]0;mine\x07"),
    "two lines": message(ADDRESS, "happy\nlivedrive: all is well"),
}


@pytest.mark.parametrize("kind", HOSTILE)
def test_a_hostile_datagram_says_nothing(kind: str, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.DEBUG):
        start = time.process_time()
        assert words_in(HOSTILE[kind]) is None
        assert time.process_time() - start < 1
    assert caplog.records == []


def test_a_program_on_this_machine_changes_the_emotion(
    port: OscPort, capsys: pytest.CaptureFixture[str]
) -> None:
    assert port.picks() == {}
    send(port.port, *HOSTILE.values(), message(ADDRESS, "furious"), message(ADDRESS, "sad", 0.5))
    assert heard(port) == "sad:0.5" and port.picks() == {}
    assert "got 'furious'" in capsys.readouterr().err
    send(port.port, *[message(ADDRESS, "furious")] * (MAX_TOLD + 9), message(ADDRESS, "angry"))
    assert heard(port) == "angry"
    assert capsys.readouterr().err.count("\n") == MAX_TOLD - 1  # with the one before
    panel = Panel(Controls("ben", "happy"), [port])
    send(port.port, message(ADDRESS, "angry:0.5"))
    deadline = time.monotonic() + 40
    while panel.read() != Controls("ben", "angry:0.5"):
        assert time.monotonic() < deadline


def test_a_taken_port_is_said(port: OscPort) -> None:
    for number in (port.port, 99_999):
        with pytest.raises(InputError, match="--listen"):
            OscPort("127.0.0.1", number, check)


@pytest.mark.slow
def test_a_run_that_is_sent_everything_goes_on_and_ends_at_ctrl_c(tmp_path: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        number = probe.getsockname()[1]
    words = ["run", "--headless", "--mic", "none", "--condition", "gaze"]
    log = tmp_path / "log"
    with log.open("w") as file:
        child = subprocess.Popen(
            [*START, *words, "--listen", str(number)],
            env=os.environ | {"PYTHONPATH": str(ROOT)},
            stderr=file,
        )
    while child.poll() is None and "got 'furious'" not in log.read_text():
        send(number, *HOSTILE.values(), message(ADDRESS, "furious"))
        time.sleep(0.1)
    child.send_signal(signal.SIGINT)
    assert child.wait(60) == 130, log.read_text()
    assert log.stat().st_size < 10_000
