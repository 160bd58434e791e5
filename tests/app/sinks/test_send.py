"""What other programs receive, through readers that are not ours, against the --arkit table."""

import socket
import threading
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic, sleep

import numpy as np
import pytest
from pylivelinkface import FaceBlendShape, PyLiveLinkFace
from pythonosc.dispatcher import Dispatcher
from pythonosc.osc_packet import OscPacket
from pythonosc.osc_server import BlockingOSCUDPServer

from app.drive.sink import FrameResult, RunInfo
from app.face.arkit import ARKIT_NAMES
from app.sinks.protocols.face import FaceReader, NamedFace
from app.sinks.protocols.osc import MAX_DATAGRAM
from app.sinks.protocols.send import QUEUE, Destination, Receiver, SendSink
from app.sinks.protocols.vmc import VmcEncoder, unity_turn
from app.sinks.protocols.vrchat import EXPRESSIONS, STRONGER, VRChatEncoder
from app.sinks.table import Outlet, open_all, parse
from encoder.types import DrivenFrame
from render.decoder.decoder import Decoder
from render.types import AHEAD
from sensors.clock import ManualClock
from sensors.types import FPS, InputError

INFO = RunInfo(64, 64, 50)


@contextmanager
def sending(url: str, decoder: Decoder) -> Iterator[SendSink]:
    (sink,) = open_all([url], Outlet(decoder, "ben", ManualClock()))
    assert isinstance(sink, SendSink)
    sink.on_start(INFO)
    try:
        yield sink
    finally:
        sink.close()


def wait_for(what: Callable[[], bool]) -> None:
    end = monotonic() + 10
    while not what():
        assert monotonic() < end, "waited in vain"
        sleep(0.005)


@contextmanager
def osc_receiver() -> Iterator[tuple[int, list[tuple[str, tuple[object, ...]]]]]:
    """A python-osc server on a free port, and the messages it has heard."""
    heard: list[tuple[str, tuple[object, ...]]] = []
    dispatcher = Dispatcher()
    dispatcher.set_default_handler(lambda address, *args: heard.append((address, args)))
    server = BlockingOSCUDPServer(("127.0.0.1", 0), dispatcher)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield server.server_address[1], heard
    finally:
        server.shutdown()
        server.server_close()


def test_vmc_carries_the_table_by_name(
    decoder: Decoder, results: list[FrameResult], table: list[dict[str, float]]
) -> None:
    with (
        osc_receiver() as (port, heard),
        sending(f"vmc://127.0.0.1:{port}", decoder) as sink,
    ):
        for tick, (result, row) in enumerate(zip(results, table, strict=True), 1):
            sink.on_frame(result)
            wait_for(lambda tick=tick: [a for a, _ in heard].count("/VMC/Ext/Blend/Apply") == tick)
            shapes = {args[0]: args[1] for a, args in heard if a == "/VMC/Ext/Blend/Val"}
            assert len(shapes) == 52
            for name, value in shapes.items():
                assert value == pytest.approx(row[str(name)], abs=1e-3)
            bones = {args[0]: args[1:] for a, args in heard if a == "/VMC/Ext/Bone/Pos"}
            assert set(bones) == {"Neck", "Head", "LeftEye", "RightEye"}
            for bone, turn in list(bones.items())[2:]:
                expected = unity_turn(-row[f"{bone}Yaw"], -row[f"{bone}Pitch"])
                assert turn == pytest.approx([0, 0, 0, *expected], abs=1e-3)
        assert sink.network_report()[f"vmc://127.0.0.1:{port}"]["sent"] == len(results)


def test_an_eye_to_the_owners_left_and_up_turns_as_in_unity() -> None:
    x, y, z, w = unity_turn(0.4, 0.2)
    # The quaternion applied to Unity's forward (0, 0, 1): left is -x, up is +y.
    forward = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
    expected = [-np.sin(0.4) * np.cos(0.2), np.sin(0.2), np.cos(0.4) * np.cos(0.2)]
    np.testing.assert_allclose(forward, expected, atol=1e-9)


def test_vrchat_carries_the_table_by_name(
    decoder: Decoder, results: list[FrameResult], table: list[dict[str, float]]
) -> None:
    with (
        osc_receiver() as (port, heard),
        sending(f"vrchat://127.0.0.1:{port}", decoder) as sink,
    ):
        for result, row in zip(results, table, strict=True):
            heard.clear()
            sink.on_frame(result)
            wait_for(lambda: "/tracking/eye/EyesClosedAmount" in [a for a, _ in heard])
            got = {address.removeprefix("/avatar/parameters/v2/"): args for address, args in heard}

            def shape(name: str, row: dict[str, float] = row) -> float:
                both = STRONGER.get(name, (name,))
                return max(row[source[0].upper() + source[1:]] for source in both)

            for name, weights in EXPRESSIONS.items():
                expected = sum(weight * shape(source) for source, weight in weights.items())
                expected += 0.75 * name.startswith("EyeLid")
                assert got[name] == (pytest.approx(expected, abs=1e-3),)
            degrees = [np.degrees(row[f"{s}Eye{a}"]) for s in ("Left", "Right") for a in _PITCH_YAW]
            pitch_yaw = got["/tracking/eye/LeftRightPitchYaw"]
            assert pitch_yaw == pytest.approx(degrees, abs=1e-3)
            assert got["EyeLeftX"] == (pytest.approx(degrees[1] / 45, abs=1e-3),)
            assert got["EyeRightY"] == (pytest.approx(-degrees[2] / 45, abs=1e-3),)


_PITCH_YAW = ("Pitch", "Yaw")


def test_vrchat_has_the_parameters_that_join_others() -> None:
    """Their sums are VRCFaceTracking's. Red before: most avatars smile, sneer and frown by them
    alone."""
    values = {"mouthSmileLeft": 0.5, "mouthFrownLeft": 0.1, "mouthStretchLeft": 0.3}
    values |= {"mouthSmileRight": 0.2, "browInnerUp": 0.5, "browOuterUpLeft": 0.2}
    values |= {"browDownLeft": 0.1, "eyeSquintRight": 0.4, "eyeWideLeft": 0.8, "noseSneerLeft": 0.6}
    values |= {"mouthUpperUpLeft": 0.4, "mouthLowerDownRight": 0.2, "mouthRollUpper": 0.3}
    arkit = np.array([values.get(name, 0.0) for name in ARKIT_NAMES], np.float32)
    right_up = np.radians([[-9, 18], [-27, 18]]).astype(np.float32)
    face = NamedFace(0, 0, arkit, AHEAD, right_up)
    messages = [m.message for d in VRChatEncoder()(face) for m in OscPacket(d).messages]
    got = {m.address.removeprefix("/avatar/parameters/v2/"): m.params[0] for m in messages}
    assert {name: pytest.approx(got[name], abs=1e-6) for name in JOINED} == JOINED


JOINED = {
    **{"SmileFrownLeft": 0.4, "SmileFrownRight": 0.2, "SmileFrown": 0.3},
    **{"SmileSadLeft": 0.2, "SmileSadRight": 0.2, "SmileSad": 0.2, "MouthSadLeft": 0.3},
    **{"BrowExpressionLeft": 0.25, "BrowExpressionRight": 0.25, "BrowExpression": 0.25},
    **{"BrowUpLeft": 0.32, "BrowUp": 0.26, "BrowDownLeft": 0.1, "BrowDown": 0.05},
    **{"BrowInnerUp": 0.5, "BrowOuterUp": 0.1, "EyeSquint": 0.4, "EyeWide": 0.8},
    **{"EyeWideLeft": 0.8, "EyeLid": 0.85, "EyeLidLeft": 0.95, "NoseSneer": 0.3},
    **{"MouthUpperUp": 0.2, "MouthLowerDown": 0.1, "MouthOpen": 0.15, "MouthStretch": 0.15},
    **{"MouthCornerYLeft": 0.4, "MouthCornerY": 0.3, "LipSuckUpper": 0.3, "LipSuck": 0.15},
    **{"LipFunnelUpper": 0.0, "LipPuckerLower": 0.0, "LipSuckFunnelUpper": 0.3},
    **{"CheekPuffSuck": 0.0, "CheekSquint": 0.0, "MouthUpperX": 0.0, "MouthLowerX": 0.0},
    **{"MouthPress": 0.0, "MouthDimple": 0.0, "EyeRightX": 0.6, "EyeX": 0.4, "EyeY": 0.4},
}


@pytest.mark.slow
def test_an_open_lid_is_three_quarters_and_a_shut_one_nothing(decoder: Decoder) -> None:
    lids: dict[str, float] = {}
    for blink in (0.0, 1.0):
        rig = np.zeros(53, np.float32)
        rig[[decoder.rig_names.index(f"eyeBlink_{s}") for s in "LR"]] = blink
        face = FaceReader(decoder)(DrivenFrame(0, 0, decoder.encode(rig), AHEAD))
        with osc_receiver() as (port, heard), socket.socket(type=socket.SOCK_DGRAM) as udp:
            for datagram in VRChatEncoder("FT/v2")(face):
                udp.sendto(datagram, ("127.0.0.1", port))
            wait_for(lambda heard=heard: "/tracking/eye/EyesClosedAmount" in dict(heard))
            lids |= {f"{blink:g}": dict(heard)["/avatar/parameters/FT/v2/EyeLidLeft"][0]}  # type: ignore[dict-item]
            assert dict(heard)["/tracking/eye/EyesClosedAmount"] == (
                pytest.approx(blink, abs=0.01),
            )
    assert lids == {"0": pytest.approx(0.75, abs=1e-3), "1": pytest.approx(0.0, abs=0.01)}


def test_live_link_carries_the_table_by_name(
    decoder: Decoder, results: list[FrameResult], table: list[dict[str, float]]
) -> None:
    with socket.socket(type=socket.SOCK_DGRAM) as udp:
        udp.bind(("127.0.0.1", 0))
        udp.settimeout(10)
        url = f"livelink://127.0.0.1:{udp.getsockname()[1]}/My%20Face"
        with sending(url, decoder) as sink:
            for result, row in zip(results, table, strict=True):
                sink.on_frame(result)
                found, face = PyLiveLinkFace.decode(udp.recv(2000))
                assert found and face.name == "My Face" and face.fps == FPS
                assert face._frames == result.driven.index  # noqa: SLF001
                for shape in FaceBlendShape:
                    assert face.get_blendshape(shape) == pytest.approx(row[shape.name], abs=1e-3)


def test_eyes_turn_as_the_app_says(table: list[dict[str, float]]) -> None:
    """A take of the app has yaw with EyeLookInLeft and EyeLookOutRight, pitch with EyeLookDown."""
    for row in table:
        for side, inward in (("Left", 1), ("Right", -1)):
            across = inward * (row[f"EyeLookIn{side}"] - row[f"EyeLookOut{side}"])
            down = row[f"EyeLookDown{side}"] - row[f"EyeLookUp{side}"]
            assert row[f"{side}EyeYaw"] * across >= 0 and abs(across) > 0
            assert row[f"{side}EyePitch"] * down >= 0 and abs(down) > 0


def test_every_datagram_fits_an_ethernet_frame(
    decoder: Decoder, results: list[FrameResult]
) -> None:
    face = FaceReader(decoder)(results[0].driven)
    for encode in (VmcEncoder(), VRChatEncoder(), VRChatEncoder("x" * 40)):
        datagrams = encode(face)
        assert len(datagrams) > 1 and max(map(len, datagrams)) <= MAX_DATAGRAM


@pytest.mark.parametrize(
    "url",
    ["", "vmc", "vmc://", "osc://127.0.0.1:1", "vmc://h:99999", "vmc://h:x", "vrchat://h/a%00b"]
    + ["vmc://[::1"],
)
def test_a_wrong_address_is_one_line(url: str) -> None:
    with pytest.raises(InputError, match="vmc://127.0.0.1:39539"):
        parse(url)


def test_an_address_of_everybody_is_refused() -> None:
    """Red before: the system's words, and nothing of which option."""
    url = "vmc://255.255.255.255:39539"
    with pytest.raises(InputError, match=f"--send {url}"):
        Receiver(url, Destination("255.255.255.255", 39539, VmcEncoder()))


def test_a_receiver_that_comes_late_is_counted_and_met(
    decoder: Decoder, results: list[FrameResult]
) -> None:
    with osc_receiver() as (port, _):
        pass
    url = f"vmc://127.0.0.1:{port}"
    with sending(url, decoder) as sink:

        def count(key: str) -> int:
            return sink.network_report()[url][key]

        def tick() -> None:
            done = count("sent") + count("lost")
            sink.on_frame(results[0])
            wait_for(lambda: count("sent") + count("lost") > done)

        for _ in range(10):
            tick()
        assert count("lost") >= 9
        with socket.socket(type=socket.SOCK_DGRAM) as udp:
            udp.bind(("127.0.0.1", port))
            udp.settimeout(10)
            tick()
            assert udp.recv(2000).startswith(b"#bundle")
            for _ in range(5):
                tick()
        assert count("reconnects") == 1


def test_a_stuck_thread_never_holds_up_the_tick(
    decoder: Decoder, results: list[FrameResult]
) -> None:
    (sink,) = open_all(["vmc://127.0.0.1:9"], Outlet(decoder, "ben", ManualClock()))
    assert isinstance(sink, SendSink)  # its thread is not started
    for result in results:
        sink.on_frame(result)
    assert sink.dropped == len(results) - QUEUE
    newest = [sink._queue.get_nowait() for _ in range(QUEUE)]  # noqa: SLF001
    assert [d.index for d in newest if d] == list(range(len(results)))[-QUEUE:]
    sink.close()


def test_an_hour_of_ticks_takes_no_memory(results: list[FrameResult], decoder: Decoder) -> None:
    """Red before: what every tick had cost was kept as a pair of Python numbers, 2 MB each."""
    receiver = Receiver("osc://127.0.0.1:9", Destination("127.0.0.1", 9, lambda face: []))
    face = FaceReader(decoder)(results[0].driven)
    tracemalloc.start()
    try:
        receiver.send(face)
        before, _ = tracemalloc.get_traced_memory()
        for _ in range(3000):
            receiver.send(face)
        after, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
        receiver.close()
    assert after - before < 30_000
    assert receiver.report()["sent"] == 3001
