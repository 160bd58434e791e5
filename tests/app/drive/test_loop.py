"""The driving loop on a manual clock: pacing, stalls and the two loop rules."""

import errno

import numpy as np
import pytest
from tone import Tone

from app.drive.loop import Drive, drive
from app.drive.sink import Expendable, FrameResult, RunInfo
from encoder.types import DrivenFrame
from render.types import AHEAD
from sensors.clock import ManualClock
from sensors.types import FPS, NS, InputError


class Counting:
    """A driver whose code says how often it was stepped."""

    closed = False

    def init_state(self, seed: int) -> int:
        return 0

    def step(self, frame, state, timer):  # noqa: ANN001, ANN201
        code = np.full(256, state, np.float32)
        return DrivenFrame(frame.index, frame.t_ns, code, AHEAD), state + 1

    def close(self) -> None:
        self.closed = True


class Keep:
    def __init__(self, fail_at: int | None = None) -> None:
        self.indices: list[int] = []
        self.closed, self.fail_at = False, fail_at

    def on_start(self, info: RunInfo) -> None: ...

    def on_frame(self, result: FrameResult) -> None:
        if result.driven.index == self.fail_at:
            raise OSError(28, "No space left on device")
        self.indices.append(result.driven.index)

    def close(self) -> None:
        self.closed = True


def run(  # noqa: ANN201
    source: Tone, clock: ManualClock, sink: Keep, realtime: bool = True,
    driver: Counting | None = None,
):  # fmt: skip
    parts = Drive(
        source=source,
        driver=driver or Counting(),  # type: ignore[arg-type]
        clock=clock,
        sinks=[sink],
        realtime=realtime,
    )
    return drive(parts)


def test_every_frame_is_stepped_once_at_its_time() -> None:
    clock, sink = ManualClock(), Keep()
    summary = run(Tone(clock, 90), clock, sink)
    assert sink.indices == list(range(90))
    assert (summary.frames, summary.dropped) == (90, 0)
    assert clock.now_ns() == pytest.approx(90 * NS // FPS, abs=2 * NS // FPS)


def test_after_a_stall_every_frame_is_stepped_and_only_the_newest_drawn() -> None:
    clock, sink = ManualClock(), Keep()
    summary = run(Tone(clock, 90, stall=range(30, 45)), clock, sink)
    assert sink.indices == list(range(90))
    assert summary.frames == 90
    assert 14 <= summary.dropped <= 15


def test_a_full_disk_still_closes_source_driver_and_sinks() -> None:
    clock, sink, driver = ManualClock(), Keep(fail_at=10), Counting()
    source = Tone(clock, 90)
    with pytest.raises(OSError, match="No space left"):
        run(source, clock, sink, driver=driver)
    assert sink.closed and source.closed and driver.closed
    assert sink.indices == list(range(10))


@pytest.mark.parametrize("failure", [ValueError, KeyboardInterrupt])
def test_all_is_closed_whatever_fails_meanwhile(failure: type[BaseException]) -> None:
    """Red before: whatever was no OSError left open what came behind it."""

    class Fails(Keep):
        def close(self) -> None:
            super().close()
            raise failure

    class FailsToo(Keep):
        def close(self) -> None:
            super().close()
            raise OSError("second")

    clock, driver, sinks = ManualClock(), Counting(), (Fails(), FailsToo(), Keep())
    words = {"source": Tone(clock, 3), "driver": driver, "clock": clock, "realtime": True}
    parts = Drive(sinks=sinks, **words)
    with pytest.raises(failure):
        drive(parts)
    assert all(sink.closed for sink in sinks) and driver.closed


@pytest.mark.parametrize(
    "error",
    [OSError(errno.ENOSPC, "No space left on device"), InputError("p: No space left, no folder")],
)
def test_a_live_run_outlives_a_full_disk(
    error: Exception, capsys: pytest.CaptureFixture[str]
) -> None:
    """Red before: the run ended, though its recording went on."""

    class Full:
        frames = 0

        def on_start(self, info: RunInfo) -> None: ...

        def on_frame(self, result: FrameResult) -> None:
            self.frames += 1
            raise error

        def close(self) -> None:
            raise error

    full, clock = Full(), ManualClock()
    summary = run(Tone(clock, 10), clock, Expendable(full))  # type: ignore[arg-type]
    assert full.frames == 1 and summary.frames == 10
    assert capsys.readouterr().err.count("No space left") == 1
