"""`--send vrchat://auto` against a stand-in that announces itself and answers as VRChat does."""

import json
import secrets
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest
from pythonosc.osc_packet import OscPacket
from waiting import wait_until
from zeroconf import IPVersion, ServiceInfo, Zeroconf

from app.drive.sink import FrameResult
from app.sinks import table
from app.sinks.protocols import oscquery, send
from app.sinks.protocols.bits import Bits
from app.sinks.protocols.face import FaceReader
from app.sinks.protocols.oscquery import CLIENT, VRChat, find
from render.decoder.decoder import Decoder
from sensors.clock import ManualClock
from sensors.types import InputError

pytestmark = pytest.mark.slow

HERE = "127.0.0.1"


@pytest.fixture(autouse=True)
def own_service(monkeypatch: pytest.MonkeyPatch) -> None:
    """All processes of this machine hear each other's announcements, and tests run side by side."""
    monkeypatch.setattr(oscquery, "SERVICE", f"_o{secrets.token_hex(6)}._tcp.local.")


def tree(*parameters: str) -> dict:
    """As VRChat answers: a node a part of the address."""
    root: dict = {"FULL_PATH": "/avatar/parameters", "CONTENTS": {}}
    for parameter in parameters:
        node, path = root, "/avatar/parameters"
        for part in parameter.split("/"):
            path += f"/{part}"
            node = node["CONTENTS"].setdefault(part, {"FULL_PATH": path, "CONTENTS": {}})
    return root


INFO = json.dumps({"NAME": "x", "OSC_IP": "10.9.9.9", "OSC_PORT": 9123}).encode()
FACE = json.dumps(tree("Speed", "FT/v2/JawOpen", "FT/v2/EyeLeftX")).encode()


@contextmanager
def vrchat(
    info: bytes, parameters: bytes, name: str = CLIENT + "-1A2B3C"
) -> Iterator[dict[str, bytes]]:
    """Yields what it answers, which may be changed."""
    answers = {"info": info, "parameters": parameters}

    class Answers(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            what = "info" if self.path == "/?HOST_INFO" else "parameters"
            if answers.get("wait") == what.encode():
                time.sleep(0.6)
            data = answers[what]
            self.send_response(200)
            self.end_headers()
            for k in range(0, len(data), 1 << 16):
                self.wfile.write(data[k : k + (1 << 16)])

        def log_message(self, *words: object) -> None: ...

    server = HTTPServer((HERE, 0), Answers)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    network = Zeroconf(interfaces=[HERE], ip_version=IPVersion.V4Only)
    network.register_service(
        ServiceInfo(
            oscquery.SERVICE,
            f"{name}.{oscquery.SERVICE}",
            addresses=[socket.inet_aton(HERE)],
            port=server.server_port,
            server=f"{name}.local.",
        )
    )
    try:
        yield answers
    finally:
        network.close()
        server.shutdown()
        server.server_close()


def looked_for() -> VRChat | None:
    """A responder may hold an answer back for more than a second."""
    return find(2.5, [HERE])


def found_in_time() -> VRChat:
    """Announcements are datagrams, which may be lost or late on a busy machine."""
    found = next((there for _ in range(5) if (there := looked_for())), None)
    assert found is not None
    return found


def test_it_is_found_with_its_port_and_the_avatars_prefix(
    decoder: Decoder, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with vrchat(INFO, FACE):
        found = found_in_time()
    assert found == VRChat(HERE, 9123, "FT/v2")  # the address that answered, not the one it claims
    assert "FT/v2" in capsys.readouterr().err
    monkeypatch.setattr(oscquery, "find", lambda: found)
    (sink,) = table.open_all(["vrchat://auto"], table.Outlet(decoder, "ben", ManualClock()))
    (receiver,) = sink.receivers  # type: ignore[union-attr]
    assert receiver._socket.getpeername() == (HERE, 9123)  # noqa: SLF001
    sink.close()


def test_parameters_that_are_bits_are_told_and_sent_as_bits(
    decoder: Decoder,
    results: list[FrameResult],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    with vrchat(INFO, json.dumps(tree(*BITS, "FT/v2/EyeLeftX")).encode()):
        found = found_in_time()
    assert found == VRChat(HERE, 9123, "FT/v2", {"JawOpen": Bits(2, False), "JawX": Bits(1, True)})
    assert "face below FT/v2, 2 of them as bits\n" in capsys.readouterr().err
    monkeypatch.setattr(oscquery, "find", lambda: found)
    face = FaceReader(decoder)(results[0].driven)

    def names(url: str) -> set[str]:
        (sink,) = table.open_all([url], table.Outlet(decoder, "ben", ManualClock()))
        (receiver,) = sink.receivers  # type: ignore[union-attr]
        sink.close()
        packets = [OscPacket(datagram) for datagram in receiver.encode(face)]
        return {
            m.message.address[len("/avatar/parameters/") :] for p in packets for m in p.messages
        }

    assert names("vrchat://auto") >= {*BITS, "FT/v2/JawOpen", "FT/v2/JawX", "FT/v2/EyeX"}
    assert not {name[-1] for name in names("vrchat://auto/Old/v2")} & set("12")  # it has none
    assert not {name[-1] for name in names("vrchat://127.0.0.1:9000/FT/v2")} & set("12")


def test_another_avatar_gets_its_own_parameters(
    decoder: Decoder, results: list[FrameResult], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its user changes it without telling the run, and VRChat starts anew on another port."""
    monkeypatch.setattr(send, "RENEW_S", 0.02)
    face = FaceReader(decoder)(results[0].driven)
    with vrchat(INFO, FACE) as answers:
        found = found_in_time()
        monkeypatch.setattr(oscquery, "find", lambda: found)
        (sink,) = table.open_all(["vrchat://auto"], table.Outlet(decoder, "ben", ManualClock()))
        (receiver,) = sink.receivers  # type: ignore[union-attr]
        sink.on_start(None)  # type: ignore[arg-type]

        def sent_to(name: str) -> bool:
            address = f"/avatar/parameters/{name}".encode() + b"\0"
            return any(address in datagram for datagram in receiver.encode(face))

        assert sent_to("FT/v2/JawOpen") and not sent_to("v2/JawOpen1")
        answers["parameters"] = json.dumps(tree("v2/JawOpen1", "v2/JawX")).encode()
        wait_until(lambda: sent_to("v2/JawOpen1"), "bits of the other avatar")
        answers["parameters"] = b"[[["  # none of a face: what most avatars take
        wait_until(lambda: not sent_to("v2/JawOpen1"), "floats alone")
        assert sent_to("v2/JawOpen")
        sink.close()
        monkeypatch.setattr(oscquery, "WAIT_S", 0.3)
        answers["wait"] = b"parameters"  # red before: an avatar without a face
        assert oscquery.again(found) is found
    monkeypatch.setattr(oscquery, "find", lambda: None)  # what answered is gone
    assert oscquery.again(found) is found
    monkeypatch.setattr(oscquery, "find", lambda: VRChat(HERE, 9124, "new/v2"))
    assert oscquery.again(found) == VRChat(HERE, 9124, "new/v2")


def test_one_that_starts_late_is_met(
    decoder: Decoder,
    results: list[FrameResult],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Red before: the run refused to begin."""
    monkeypatch.setattr(send, "RENEW_S", 0.02)
    monkeypatch.setattr(oscquery, "find", lambda: None)
    (sink,) = table.open_all(["vrchat://auto"], table.Outlet(decoder, "ben", ManualClock()))
    assert "no VRChat with OSC on is here yet" in capsys.readouterr().err
    (receiver,) = sink.receivers  # type: ignore[union-attr]
    with socket.socket(type=socket.SOCK_DGRAM) as game:
        game.bind((HERE, 0))
        sink.on_start(None)  # type: ignore[arg-type]
        sink.on_frame(results[0])
        wait_until(lambda: receiver.lost == 1, "a tick to nobody")
        there = VRChat(HERE, game.getsockname()[1], "FT/v2")
        monkeypatch.setattr(oscquery, "find", lambda: there)
        wait_until(lambda: receiver.encode is not None, "the game")
        sink.on_frame(results[0])
        assert b"/FT/v2/" in game.recv(1 << 16)
        sink.close()


BITS = [f"FT/v2/{name}" for name in ("JawOpen1", "JawOpen2", "JawX1", "JawXNegative")]


def test_none_and_several_are_told() -> None:
    assert looked_for() is None
    with (
        vrchat(INFO, FACE),
        vrchat(INFO.replace(b"9123", b"9124"), FACE, CLIENT + "-2"),
        pytest.raises(InputError, match=f"several: {HERE}:912"),
    ):
        find(4.0, [HERE])  # two that announce at once keep their answers back for about a second


@pytest.mark.parametrize(
    ("info", "parameters"),
    [
        (b"[" * 100_000, FACE),
        (b"null", FACE),
        (b'{"OSC_PORT": true}', FACE),
        (b'{"OSC_PORT": 1e9}', FACE),
        (b"{" + b" " * (oscquery.MAX_ANSWER + 9), FACE),
    ],
)
def test_what_answers_nonsense_is_no_vrchat(info: bytes, parameters: bytes) -> None:
    with vrchat(info, parameters):
        assert looked_for() is None


@pytest.mark.parametrize(
    "parameters",
    [b"", b"[[[", b'{"FULL_PATH": 5, "CONTENTS": {"a": {"FULL_PATH": "/avatar/parameters/x"}}}'],
)
def test_an_avatar_without_a_face_is_told_and_served(
    parameters: bytes, capsys: pytest.CaptureFixture[str]
) -> None:
    with vrchat(INFO, parameters):
        assert found_in_time() == VRChat(HERE, 9123, None)
    assert "no face parameters" in capsys.readouterr().err


def test_an_answer_that_drips_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """A byte now and then would hold a timeout of each read off for ever."""
    monkeypatch.setattr(oscquery, "WAIT_S", 0.5)
    with socket.create_server((HERE, 0)) as server:

        def drip() -> None:
            end, _ = server.accept()
            with end:
                try:
                    while True:
                        end.send(b"H")
                        time.sleep(0.1)
                except OSError:
                    return

        threading.Thread(target=drip, daemon=True).start()
        there = oscquery.Announced(CLIENT, HERE, server.getsockname()[1], {})
        monkeypatch.setattr(oscquery, "announced", lambda *words: [there])
        assert looked_for() is None
