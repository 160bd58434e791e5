"""What is asked for once, to start anew or to recentre, is recorded and done again by a replay."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from tone import Tone

from app.drive.controls import Controls, RequestControl
from app.drive.loop import Drive, drive
from app.drive.sink import FrameResult, RunInfo
from encoder.types import DrivenFrame
from render.types import AHEAD
from sensors.assemble import Assembler
from sensors.clock import ManualClock
from sensors.session.recording import Recording, RecordingWriter
from sensors.session.replay import ReplaySource
from sensors.types import FPS, NS, AudioPacket, Packet, RequestPacket, Source


def sound(k: int) -> AudioPacket:
    return AudioPacket(k * NS // FPS, k * 1600, np.zeros(1600, np.float32))


def asked(control: RequestControl, packets: list[Packet], **counts: int) -> list[str]:
    found = control.inject_requests(packets, Controls("ben", **counts))
    return [p.wanted if isinstance(p, RequestPacket) else "-" for p in found]


def test_a_request_is_made_once_before_the_next_packet() -> None:
    control = RequestControl()
    assert asked(control, [sound(0), sound(1)]) == ["-", "-"]
    assert asked(control, [], recentred=1) == []
    assert asked(control, [sound(2), sound(3)], recentred=1) == ["recentre", "-", "-"]
    assert asked(control, [sound(4)], recentred=1, resets=1) == ["reset", "-"]
    assert asked(control, [sound(5)], recentred=3, resets=2) == ["reset", "recentre", "-"]
    assert asked(control, [sound(6)], recentred=3, resets=2) == ["-"]


def test_a_request_belongs_to_the_frame_in_the_making() -> None:
    assembler = Assembler()
    for packet in (sound(0), RequestPacket(5, "reset"), RequestPacket(0, "recentre"), sound(1)):
        assembler.push(packet)
    assembler.push(sound(2))
    assert [f.requests for f in assembler.ready()] == [(), ("reset", "recentre"), ()]


def test_a_flood_of_requests_takes_no_memory() -> None:
    assembler = Assembler()
    for _ in range(100):
        assembler.push(RequestPacket(0, "recentre"))
    assembler.push(RequestPacket(0, "reset"))
    assembler.push(sound(0))
    (frame,) = assembler.ready()
    assert len(frame.requests) < 10 and frame.requests[-1] == "reset"


class Counts:
    """A driver whose code says how often it was stepped, and recentred (100 each)."""

    def init_state(self, seed: int) -> int:
        return 0

    def step(self, frame, state, timer):  # noqa: ANN001, ANN201
        for wanted in frame.requests:
            state = 0 if wanted == "reset" else 100 + state
        return DrivenFrame(frame.index, frame.t_ns, np.full(1, state), AHEAD), state + 1

    def close(self) -> None: ...


class Somebody:
    """Recentres at the fourth tick and starts anew at the seventh."""

    ticks = 0

    def read(self) -> Controls:
        self.ticks += 1
        return Controls("ben", recentred=int(self.ticks > 3), resets=int(self.ticks > 6))


class Codes(list[int]):
    """A sink."""

    def on_start(self, info: RunInfo) -> None: ...

    def on_frame(self, result: FrameResult) -> None:
        self.append(int(result.driven.expression[0]))

    def close(self) -> None: ...


def run(
    source: Source, clock: ManualClock, record: Callable[[Packet], None] | None = None
) -> Codes:
    codes, panel = Codes(), Somebody() if record else None
    drive(
        Drive(
            source=source,
            driver=Counts(),  # type: ignore[arg-type]
            clock=clock,
            sinks=[codes],
            panel=panel,
            record=record,
            realtime=True,
        )
    )
    return codes


def test_a_replay_does_what_was_asked_for_in_the_run(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "tape", created="") as writer:
        clock = ManualClock()
        codes = run(Tone(clock, 10), clock, writer.append)
    assert max(codes) >= 100 and codes.count(0) == 2
    clock = ManualClock()
    assert run(ReplaySource(Recording(tmp_path / "tape"), clock), clock) == codes
