"""A tracker as a Source: a real port, recorded poses, and the stream through a session."""

import socket
import time
from pathlib import Path

import numpy as np
import pytest
from head_packets import bone, osc, pose

from sensors.assemble import HEAD_TOLERANCE_NS, Assembler
from sensors.clock import ManualClock, MonotonicClock
from sensors.head import vmc
from sensors.head.gate import ReadingCounts, ReadingGate
from sensors.head.links import PlayedHeadLink, UdpLink
from sensors.head.source import LOST, WAITING, HeadSource
from sensors.head.spec import SCHEMES, head_source
from sensors.session.recording import Recording, RecordingWriter
from sensors.types import NS, SAMPLES_PER_FRAME, AudioPacket, HeadPacket, HeadPose, InputError

FRAME_NS = NS // 30


def silent(line: str) -> None:
    raise AssertionError(line)


def packets(count: int) -> list[HeadPacket]:
    return [HeadPacket(k * FRAME_NS, HeadPose((float(k), 0.0, 0.0))) for k in range(count)]


def sound(k: int) -> AudioPacket:
    return AudioPacket(k * FRAME_NS, k * SAMPLES_PER_FRAME, np.zeros(SAMPLES_PER_FRAME, np.float32))


def test_poses_come_through_a_port_and_a_flood_ends_nothing() -> None:
    told: list[str] = []
    gate = ReadingGate("vmc", told.append)
    link = UdpLink("127.0.0.1", 0, vmc.VmcDecoder(), vmc.MAX_DATAGRAM, gate, MonotonicClock())
    source = HeadSource("vmc", lambda: link, MonotonicClock())
    with pytest.raises(RuntimeError):
        source.poll()
    source.open()
    assert source.problem == WAITING
    datagram, junk = osc(bone("Head", pose(0, 10, 0))), b"#bundle\0" + bytes(40)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        got: list[HeadPacket] = []
        deadline = time.monotonic() + 30
        while not got and time.monotonic() < deadline:
            for data in (junk, bytes(9000), datagram):
                sender.sendto(data, ("127.0.0.1", link.port))
            got += source.poll()
        assert got and source.problem == ""
        while not gate.counts.flooded and time.monotonic() < deadline:
            for _ in range(500):
                sender.sendto(datagram, ("127.0.0.1", link.port))
    assert len(told) == 1 and source.dropped > 0
    again = HeadSource("vmc", lambda: UdpLink(*_taken(link.port, gate)), MonotonicClock())
    with pytest.raises(InputError, match="choose another port"):
        again.open()
    source.close()
    source.close()


def _taken(port: int, gate: ReadingGate):  # type: ignore[no-untyped-def]
    return "127.0.0.1", port, vmc.VmcDecoder(), vmc.MAX_DATAGRAM, gate, MonotonicClock()


def test_a_silent_tracker_is_lost() -> None:
    clock = ManualClock()
    source = HeadSource("test", lambda: PlayedHeadLink(packets(2)[:1], ManualClock()), clock)
    source.open()
    assert len(source.poll()) == 1 and source.problem == ""
    clock.sleep_until_ns(NS)
    assert source.poll() == [] and source.problem == LOST


def test_played_poses_keep_their_pace_and_go_round() -> None:
    clock = ManualClock()
    link = PlayedHeadLink(packets(3), clock)
    assert link.counts == ReadingCounts()
    clock.sleep_until_ns(NS)
    link.open()
    clock.sleep_until_ns(NS + 4 * FRAME_NS + 5)
    got = link.poll()
    assert [p.t_ns for p in got] == [NS + k * FRAME_NS for k in range(5)]
    assert [p.pose.position[0] for p in got] == [0, 1, 2, 0, 1]


def test_frames_hold_the_newest_pose_until_it_is_too_old() -> None:
    assembler = Assembler()
    poses = packets(6)
    assembler.push(HeadPacket(10**15, HeadPose((9.0, 9.0, 9.0))))  # of the far future
    for k in range(12):
        assembler.push(sound(k))
    assert all(f.head is None and f.head_age_ns == -1 for f in assembler.ready())
    assembler = Assembler()
    for k in range(12):
        for packet in poses[k : k + 1]:
            assembler.push(packet)
        assembler.push(sound(k))
    frames = assembler.ready()
    assert [f.head.position[0] for f in frames if f.head] == [*range(6), *[5] * 6]
    assert all(f.head_valid == (f.head_age_ns <= HEAD_TOLERANCE_NS) for f in frames)
    assert frames[0].head_valid and not frames[-1].head_valid
    lost = Assembler()
    lost.push(HeadPacket(0, HeadPose(), valid=False))
    lost.push(sound(0))
    assert not lost.ready()[0].head_valid


def write(folder: Path, poses: list[HeadPacket]) -> Path:
    with RecordingWriter(folder, created="", devices={"head": "test"}) as writer:
        for k in range(8):
            for packet in poses[2 * k : 2 * k + 2]:
                writer.append(packet)
            writer.append(sound(k))
    return folder


def test_a_session_keeps_poses_to_the_bit(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    turns = rng.standard_normal((9, 4))
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    poses = [
        HeadPacket(
            k * FRAME_NS, HeadPose(tuple(rng.normal(size=3).tolist()), tuple(q.tolist())), k != 3
        )
        for k, q in enumerate(turns)
    ]
    with Recording(write(tmp_path / "s", poses)) as recording:
        assert recording.info.head and recording.info.devices["head"] == "test"
        got = [recording.packet(e) for e in recording.heads]
    assert [(p.t_ns, p.pose.position, p.valid) for p in got if isinstance(p, HeadPacket)] == [
        (p.t_ns, p.pose.position, p.valid) for p in poses
    ]
    with Recording(write(tmp_path / "again", got)) as recording:  # type: ignore[arg-type]
        assert [recording.packet(e) for e in recording.heads] == got


@pytest.mark.parametrize(
    "line",
    [
        '{"stream":"head","t_ns":0,"position":[0,0],"quat":[1,0,0,0],"valid":true}',
        '{"stream":"head","t_ns":0,"position":[0,0,NaN],"quat":[1,0,0,0],"valid":true}',
        '{"stream":"head","t_ns":0,"position":[0,0,0],"quat":[0,0,0,0],"valid":true}',
        '{"stream":"head","t_ns":0,"position":"abc","quat":[1,0,0,0],"valid":true}',
        '{"stream":"head","t_ns":0,"quat":[1,0,0,0],"valid":true}',
    ],
)
def test_a_damaged_line_is_said(tmp_path: Path, line: str) -> None:
    folder = write(tmp_path / "s", packets(2))
    with (folder / "timeline.jsonl").open("a") as file:
        file.write(line + "\n")
    with pytest.raises(InputError, match="bad line"):
        Recording(folder)


@pytest.mark.parametrize("host", ["ü..x", "a" * 70])
def test_a_host_that_is_none_is_said(host: str) -> None:
    """Red before: a traceback."""
    source = head_source(f"vmc://{host}:39539", ManualClock(), silent)
    with pytest.raises(InputError, match=r"--head: expected to listen"):
        source.open()


def test_specs(tmp_path: Path) -> None:
    clock = ManualClock()
    session = write(tmp_path / "s", packets(3))
    source = head_source(f"session:{session}", clock, silent)
    source.open()
    assert len(source.poll()) == 1 and source.info.head
    source.close()
    for spec in ("vmc://:0", "livelink://127.0.0.1:0", "vrchat://:0"):
        source = head_source(spec, clock, silent)
        source.open()
        source.close()
    empty = write(tmp_path / "empty", [])
    no_text = tmp_path / "no_text.csv"
    no_text.write_bytes(bytes(range(128, 256)))
    bad = (
        "vmc",
        "vmc:",
        "vmc://:99999",
        "vmc://:x",
        "vmc://:1/x",
        "vmc://[::1",
        "nosuch://:1",
        "",
        "file:none.csv",
        f"file:{no_text}",
    )
    for spec in (*bad, f"session:{empty}", f"session:{tmp_path}"):
        with pytest.raises(InputError):
            head_source(spec, clock, silent)
    assert set(SCHEMES) == {"vmc", "livelink", "vrchat", "session", "file"}
