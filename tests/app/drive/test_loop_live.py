"""The loop on a live source: the sample count is the clock, and what is heard is recorded."""

import numpy as np
import pytest

from app.drive.loop import Drive, drive
from app.drive.sink import FrameResult, RunInfo
from encoder.types import DrivenFrame
from render.types import AHEAD
from sensors.clock import ManualClock
from sensors.types import FPS, NS, SAMPLES_PER_FRAME, AudioPacket, Packet, SourceInfo


class Device:
    """Sound whose clock runs at `rate` times ours; recorded if it has a duration."""

    dropped = 0

    def __init__(self, clock: ManualClock, frames: int, rate: float, duration: int | None) -> None:
        self.clock, self.frames, self.rate = clock, frames, rate
        self.info = SourceInfo("device", duration_ns=duration)
        self.sent = 0

    @property
    def exhausted(self) -> bool:
        return self.sent >= self.frames

    def open(self) -> None:
        self.start_ns = self.clock.now_ns()

    def poll(self) -> list[Packet]:
        period_ns = NS / FPS / self.rate
        due = min(int((self.clock.now_ns() - self.start_ns) / period_ns), self.frames)
        first, self.sent = self.sent, max(self.sent, due)
        silence = np.zeros(SAMPLES_PER_FRAME, np.float32)
        return [
            AudioPacket(self.start_ns + round(k * period_ns), k * SAMPLES_PER_FRAME, silence)
            for k in range(first, self.sent)
        ]

    def close(self) -> None:
        pass


class Still:
    def init_state(self, seed: int) -> int:
        return 0

    def step(self, frame, state, timer):  # noqa: ANN001, ANN201
        return DrivenFrame(frame.index, frame.t_ns, np.zeros(256, np.float32), AHEAD), state


class Ages:
    """How old each frame's newest sample was when its code existed."""

    def __init__(self) -> None:
        self.ns: list[int] = []

    def on_start(self, info: RunInfo) -> None: ...

    def on_frame(self, result: FrameResult) -> None:
        self.ns.append(result.code_ns - result.sensors.t_ns)

    def close(self) -> None: ...


def run(device: Device, clock: ManualClock, realtime: bool = True, record=None):  # noqa: ANN001, ANN201
    ages = Ages()
    parts = Drive(
        source=device,
        driver=Still(),  # type: ignore[arg-type]
        clock=clock,
        sinks=[ages],
        record=record,
        realtime=realtime,
    )
    return drive(parts), ages.ns


@pytest.mark.parametrize("rate", [0.99, 1.0, 1.01])
def test_a_device_with_a_clock_of_its_own_is_never_left_behind(rate: float) -> None:
    clock = ManualClock(NS)
    summary, ages = run(Device(clock, 900, rate, None), clock)
    assert (summary.frames, summary.dropped) == (900, 0)
    # 1 ms between two looks, 2 ms before the assembler follows the packet times, drift of a frame
    assert max(ages[1:]) <= 3_500_000
    assert min(ages[1:]) >= -3_500_000


def test_a_fast_replay_draws_every_frame_however_the_packets_come() -> None:
    clock = ManualClock(NS)
    device = Device(clock, 30, 1.0, NS)
    clock.advance_ns(0)
    poll, waiting = device.poll, []

    def in_threes() -> list[Packet]:
        clock.advance_ns(NS // FPS)
        waiting.extend(poll())
        if len(waiting) < 3 and not device.exhausted:
            return []
        given, waiting[:] = waiting[:], []
        return given

    device.poll = in_threes  # type: ignore[method-assign]
    summary, _ = run(device, clock, realtime=False)
    assert (summary.frames, summary.dropped) == (30, 0)


def test_what_the_driver_hears_is_what_is_recorded() -> None:
    clock, heard = ManualClock(NS), list[Packet]()
    summary, _ = run(Device(clock, 30, 1.0, None), clock, record=heard.append)
    assert summary.frames == len(heard) == 30
