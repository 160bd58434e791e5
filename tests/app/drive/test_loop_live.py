"""The loop on a live source: the sample count is the clock, and what is heard is recorded."""

import numpy as np
import pytest
from tone import Tone

from app.drive.loop import Drive, drive
from app.drive.sink import FrameResult, RunInfo
from encoder.types import DrivenFrame
from render.types import AHEAD
from sensors.clock import ManualClock
from sensors.types import FPS, NS, Packet


class Still:
    def init_state(self, seed: int) -> int:
        return 0

    def step(self, frame, state, timer):  # noqa: ANN001, ANN201
        return DrivenFrame(frame.index, frame.t_ns, np.zeros(256, np.float32), AHEAD), state

    def close(self) -> None: ...


class Ages:
    """How old each frame's newest sample was when its code existed."""

    def __init__(self) -> None:
        self.ns: list[int] = []

    def on_start(self, info: RunInfo) -> None: ...

    def on_frame(self, result: FrameResult) -> None:
        self.ns.append(result.code_ns - result.sensors.t_ns)

    def close(self) -> None: ...


def run(device: Tone, clock: ManualClock, realtime: bool = True, record=None):  # noqa: ANN001, ANN201
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


@pytest.mark.slow
@pytest.mark.parametrize("rate", [0.99, 1.0, 1.01])
def test_a_device_with_a_clock_of_its_own_is_never_left_behind(rate: float) -> None:
    clock = ManualClock(NS)
    summary, ages = run(Tone(clock, 900, rate=rate), clock)
    assert (summary.frames, summary.dropped) == (900, 0)
    # 1 ms between two looks, 2 ms before the assembler follows the packet times, drift of a frame
    assert max(ages[1:]) <= 3_500_000
    assert min(ages[1:]) >= -3_500_000


def test_a_fast_replay_draws_every_frame_however_the_packets_come() -> None:
    clock = ManualClock(NS)
    device = Tone(clock, 30, duration_ns=NS)
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
    summary, _ = run(Tone(clock, 30), clock, record=heard.append)
    assert summary.frames == len(heard) == 30
