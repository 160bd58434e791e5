"""What stands between the loop and the call: echo canceller, tape with consent, the wire; and the
call's process, whose loudspeaker has a thread of its own."""

import asyncio
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from subprocess import TimeoutExpired
from types import SimpleNamespace

import numpy as np
import pytest

from app.call.core.call import Call
from app.call.live import protocol
from app.call.live.echo import BLOCK, EchoCanceller
from app.call.live.gate import Gate
from app.call.live.link import CallLink, CallSink
from app.call.live.protocol import CallSettings
from app.call.live.service import Service
from app.call.live.tape import CallTape
from app.call.rooms.room import BYE, HELLO, Events, LineSettings
from app.call.table.seats import Seats
from app.call.trial.material import synthetic_material
from app.call.wire.agreement import Hello, new_identity
from app.call.wire.invite import Invite
from app.call.wire.packet import Tick
from app.commands.meet.keys import keys, obey
from app.compose.settings import SoundSettings
from app.drive.controls import Controls
from app.drive.sink import FrameResult
from app.process.channel import Channel, pair
from encoder.types import DrivenFrame
from render.types import AHEAD
from sensors.clock import MonotonicClock
from sensors.types import AudioPacket, Clock, EyePacket, Packet, SourceInfo

INVITE = f"livedrive://127.0.0.1:9/#{'A' * 22}.{'A' * 43}"
Pull = Callable[[int, int], object]


def test_the_loudspeaker_is_taken_out_of_the_microphone() -> None:
    rng = np.random.default_rng(0)
    blocks = 600
    gate = np.sin(2 * np.pi * np.arange(blocks * BLOCK) / 48_000 * 1.5) > 0
    far = 0.1 * rng.standard_normal(blocks * BLOCK) * gate
    room = np.zeros(1200)
    room[900], room[1100] = 0.5, 0.2
    echo = np.convolve(far, room)[: len(far)].astype(np.float32)
    canceller, left = EchoCanceller(echo=True, noise=False), []
    for k in range(blocks):
        block = slice(k * BLOCK, (k + 1) * BLOCK)
        canceller.played((far[block] * 32767).astype("<i2").tobytes())
        left.append(canceller.clean(echo[block]))
    half = len(echo) // 2
    rest = np.concatenate(left)[half:]
    assert 10 * np.log10(np.mean(echo[half:] ** 2) / np.mean(rest**2)) > 20  # dB


@pytest.mark.parametrize("size", [480, 441, 1, 1600])
def test_as_many_samples_come_out_as_went_in(size: int) -> None:
    canceller = EchoCanceller(echo=True, noise=True)
    for _ in range(20):
        out = canceller.clean(np.full(size, np.nan, np.float32))
        assert out.shape == (size,) and np.isfinite(out).all()


@pytest.mark.parametrize("sizes", [(441,), (1600,), (441, 1600, 7)])
def test_sound_is_whole_whatever_the_size_of_its_blocks(sizes: tuple[int, ...]) -> None:
    """Red before: zeros in the midst of the first 150 ms, where blocks were not of 10 ms."""
    sound = np.random.default_rng(0).standard_normal(60 * BLOCK).astype(np.float32) * 0.1
    whole, pieces = (EchoCanceller(echo=False, noise=False) for _ in range(2))
    expected = np.concatenate([whole.clean(block) for block in sound.reshape(-1, BLOCK)])
    ends = np.cumsum(np.resize(sizes, 40))
    got = np.concatenate([pieces.clean(s) for s in np.split(sound[: ends[-1]], ends[:-1])])
    late = BLOCK - 1
    np.testing.assert_array_equal(got[late:], expected[: len(got) - late])


def test_a_worn_loudspeaker_needs_no_canceller() -> None:
    sound = SoundSettings()
    assert sound.is_on("auto", None) and sound.is_on("on", "Headset")
    assert not sound.is_on("auto", "USB Headset") and not sound.is_on("off", None)


def test_ticks_and_sound_cross_as_they_are() -> None:
    rng = np.random.default_rng(1)
    head = np.array([1, 2, 3], np.float32), np.array([0.8, 0, 0.6, 0], np.float32), 0.25
    tick = Tick(7, rng.standard_normal(256).astype(np.float32), AHEAD, *head)
    got, end_ns = protocol.unpack_tick(protocol.pack_tick(tick, 99))
    assert end_ns == 99 and got.index == 7 and np.array_equal(got.expression, tick.expression)
    assert np.array_equal(got.head_mm, head[0]) and np.array_equal(got.head_wxyz, head[1])
    assert got.breath == 0.25
    samples = rng.standard_normal(480).astype(np.float32)
    first, sound, t_ns = protocol.unpack_sound(protocol.pack_sound(5, 6, samples))
    assert (first, t_ns) == (5, 6) and np.array_equal(sound, samples)


class Link:
    muted = eyes_muted = ended = False
    error = ""

    def __init__(self) -> None:
        self.seats, self.changes = Seats(), []

    def change(self, **state: object) -> None:
        self.changes.append(state)
        vars(self).update(state)

    def read(self) -> None: ...
    def post(self, packet: bytes) -> None: ...


class Recorder:
    def __init__(self) -> None:
        self.problem, self.packets, self.closed = "", [], False

    def append(self, packet: Packet) -> None:
        self.packets.append(packet)

    def close(self) -> None:
        self.closed = True


def test_nothing_is_written_without_consent(tmp_path: Path) -> None:
    link, recorders = Link(), []

    def record_to(folder: Path) -> Recorder:
        folder.mkdir()
        recorders.append(Recorder())
        return recorders[-1]

    tape = CallTape(link, tmp_path / "take", record_to)  # type: ignore[arg-type]
    packet = AudioPacket(0, 0, np.zeros(480, np.float32))
    tape.append(packet)
    assert not recorders and link.changes == [{"records": True}]
    link.seats.may_record = True
    tape.append(packet)
    assert len(recorders[0].packets) == 1
    link.seats.may_record = False  # somebody takes it back
    tape.append(packet)
    assert len(recorders[0].packets) == 1
    link.seats.may_record = True
    tape.append(packet)
    assert tape.wanted and len(recorders) == 2
    tape.apply(replace(Controls(avatar="ben"), recording=False))
    assert link.changes[-1] == {"records": False}
    tape.close()
    assert recorders[0].closed and recorders[1].closed
    assert [p.name for p in tape.sessions] == ["take", "take-001"]


def test_no_tick_waits_for_a_recording_that_ends(tmp_path: Path) -> None:
    """Red before: it did, in a call."""
    link, goes_on = Link(), threading.Event()

    class Slow(Recorder):
        def close(self) -> None:
            assert goes_on.wait(30)
            self.problem = "the disk is full"

    tape = CallTape(link, tmp_path / "take", lambda folder: Slow())  # type: ignore[arg-type]
    link.seats.may_record = True
    tape.append(AudioPacket(0, 0, np.zeros(480, np.float32)))
    link.seats.may_record = False
    ticking = threading.Thread(target=tape.follow, daemon=True)
    ticking.start()
    ticking.join(5)
    assert not ticking.is_alive()
    goes_on.set()
    tape.close()
    assert tape.problem == "the disk is full"


def test_what_was_not_recorded_is_not_said_to_be_written(tmp_path: Path) -> None:
    """Red before: "wrote DIR; next: livedrive replay DIR", and there was no such folder."""
    link, recorder = Link(), Recorder()
    recorder.problem = "No space left on device"
    link.seats.may_record = True
    tape = CallTape(link, tmp_path / "take", lambda folder: recorder)  # type: ignore[arg-type]
    tape.append(AudioPacket(0, 0, np.zeros(480, np.float32)))
    assert tape.failed
    tape.close()
    assert tape.problem == recorder.problem and tape.sessions == []


class Sensors:
    """A source of one packet of sound and one picture."""

    info, exhausted, dropped = SourceInfo("stand-in"), False, 0

    def open(self) -> None: ...
    def poll(self) -> list[Packet]:
        sound = AudioPacket(0, 0, np.ones(480, np.float32))
        return [sound, EyePacket(0, 0, 0, np.zeros((400, 400), np.uint8))]

    def close(self) -> None: ...


def test_what_is_muted_does_not_reach_the_driver() -> None:
    link = Link()
    gate = Gate(Sensors(), link)  # type: ignore[arg-type]
    sound, eye = gate.poll()
    assert isinstance(sound, AudioPacket) and sound.samples.all() and isinstance(eye, EyePacket)
    link.muted = True
    sound, eye = gate.poll()
    assert isinstance(sound, AudioPacket) and not sound.samples.any()
    link.eyes_muted = True
    assert [type(p) for p in gate.poll()] == [AudioPacket]


def test_a_call_that_has_failed_ends_the_run() -> None:
    """Red before: whoever joined a call that was not open drove a head alone until Ctrl-C."""
    link = Link()
    gate = Gate(Sensors(), link)  # type: ignore[arg-type]
    assert not gate.exhausted
    link.error = "call join: expected somebody"
    assert gate.exhausted


def test_a_call_whose_process_is_gone_is_told_once() -> None:
    """Red before: the run went on without a word, and nobody heard it."""
    link, told = Link(), list[str]()
    sink = CallSink(link, told.append)  # type: ignore[arg-type]
    driven = DrivenFrame(0, 0, np.zeros(256, np.float32), AHEAD)
    result = FrameResult(None, driven, None)  # type: ignore[arg-type]
    sink.on_frame(result)
    assert not told
    link.ended = True
    for _ in range(3):
        sink.on_frame(result)
    assert len(told) == 1 and "nobody hears you" in told[0]


class Process:
    """A call's process that ends when it is told to, with its report first."""

    def __init__(self, end: Channel) -> None:
        self._end = end

    def wait(self, timeout: float) -> None:
        if protocol.END not in self._end.waiting():
            raise TimeoutExpired("call", timeout)
        self._end.send(protocol.pack_json(protocol.REPORT, {"ben": {}}))


def test_a_report_finds_room_behind_all_that_was_played() -> None:
    """Red before: while a long file was finished nobody read what the loudspeaker played, and the
    report of the call was empty."""
    link = CallLink(CallSettings(name="Ann", avatar="ben"), lambda line: None)
    process = link._theirs
    link._process = Process(process)  # type: ignore[assignment]
    with pytest.raises(BlockingIOError):
        while True:
            process.send(protocol.PLAYED + bytes(960))
    link.close()
    assert link.report == {"ben": {}}


def test_what_is_typed_is_answered() -> None:
    """Red before: nothing was said, so nobody at a terminal knew whether they were muted."""
    link = Link()
    words = ["m", "m", "e", "y", "r", "a"]
    said = [obey(link, None, word) for word in words]  # type: ignore[arg-type]
    assert said[0] == "your voice is muted" and said[1] == "your voice is not muted"
    assert "eyes are muted" in said[2] and "accepted" in said[3] and len(link.changes) == 6
    for word in ("mute", "s"):  # a window has a button to record
        assert obey(link, None, word) == keys(None) and len(link.changes) == 6  # type: ignore[arg-type]


def test_an_end_without_a_window_records_at_a_word(tmp_path: Path) -> None:
    """Red before: it recorded from the start, or not at all."""
    link = Link()
    tape = CallTape(link, None, lambda folder: Recorder())  # type: ignore[arg-type]
    packet = AudioPacket(0, 0, np.zeros(480, np.float32))
    assert "s records" in keys(tape)
    assert "s stops" in obey(link, tape, "s")  # type: ignore[arg-type]
    tape.append(packet)
    assert "s records" in obey(link, tape, "s")  # type: ignore[arg-type]
    tape.append(packet)
    assert link.changes == [{"records": True}, {"records": False}]


def test_nobody_leaves_while_the_loudspeaker_reads(monkeypatch: pytest.MonkeyPatch) -> None:
    """Red before: their decoder was freed in the midst of it; or the loudspeaker's thread ended
    because the partners had changed while it went through them."""
    basis, ben = synthetic_material(3, 0).basis, new_identity()
    hello = Hello(identity=ben, name="Ben", basis=basis.number)
    pulls, reads, left = list[Pull](), threading.Event(), list[bool]()

    class Room:
        """Ben comes, and leaves while he is heard."""

        def __init__(self, _: Invite, events: Events, __: LineSettings) -> None:
            self.events = events

        async def run(self) -> None:
            self.events.message(ben, HELLO + hello.to_bytes())
            loudspeaker = threading.Thread(target=pulls[0], args=(480, 0))
            loudspeaker.start()
            assert reads.wait(10)
            self.events.message(ben, BYE)
            loudspeaker.join()

        async def close(self) -> None: ...
        def say(self, message: bytes) -> None: ...

    def speaker(_: str, __: Clock, pull: Pull) -> SimpleNamespace:
        pulls.append(pull)
        return SimpleNamespace(close=lambda: None)

    def slow_pull(call: Call, count: int, _: int) -> np.ndarray:
        assert ben in call.partners
        reads.set()
        time.sleep(0.2)
        left.append(ben not in call.partners)
        return np.zeros(count, np.float32)

    monkeypatch.setattr("app.call.live.service.DirectGuest", Room)
    monkeypatch.setattr("app.call.live.service.Speaker", speaker)
    monkeypatch.setattr(Call, "pull", slow_pull)
    ours, theirs = pair()
    try:
        service = Service(theirs, Seats(), basis, MonotonicClock(), 0)
        asyncio.run(service.run(CallSettings(name="ann", avatar="ben", invite=INVITE)))
    finally:
        ours.close()
        theirs.close()
    assert left == [False]
