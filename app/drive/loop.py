"""The driving loop: packets in, pictures out.

    Source.poll -> Assembler -> SensorFrame -> Driver.step -> DrivenFrame -> View.draw -> sinks

Two rules: a frame exists when its 1600 samples exist, and every frame is stepped. After a stall
the loop steps through all queued frames and draws the newest: it never skips a step, it skips a
draw. Live and replay differ only in the source and the clock.
"""

import gc
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

from app.drive.controls import ControlPanel, Controls, RequestControl, muted
from app.drive.emotion import EmotionControl
from app.drive.sink import FrameResult, RunInfo, Sink
from app.drive.stages import Stages
from sensors.assemble import Assembler
from sensors.types import FPS, NS, Clock, Packet, Source

if TYPE_CHECKING:
    from app.drive.view import View
    from encoder.driver import Driver


@dataclass(frozen=True, kw_only=True)
class Drive:
    """The parts of one run; app/compose/build.py makes them from settings."""

    source: Source
    driver: "Driver"
    clock: Clock
    sinks: Sequence[Sink] = ()
    view: "View | None" = None  # None: codes only, nothing is drawn
    panel: ControlPanel | None = None
    ports: "Sequence[Closable]" = ()  # of the panel, closed at the end
    record: Callable[[Packet], None] | None = None  # sees what the driver gets, before assembly
    stages: Stages = field(default_factory=Stages)
    info: RunInfo = RunInfo(0, 0, None)
    seed: int = 0
    emotion: str = ""  # that was asked for at the start
    gaussians: str = ""  # how many are drawn, for reports
    realtime: bool = False


class Closable(Protocol):
    def close(self) -> None: ...


@dataclass
class Summary:
    """Counts of a finished run."""

    frames: int = 0  # stepped
    dropped: int = 0  # stepped and not drawn
    late_ns: int = 0  # how far the worst tick ran over its deadline


def drive(parts: Drive, summary: Summary | None = None) -> Summary:
    """Run until the source is exhausted, the panel is closed or Ctrl-C; every part is closed.

    `summary` is filled while it runs, for who catches Ctrl-C."""
    source, driver, clock, stages = parts.source, parts.driver, parts.clock, parts.stages
    summary, state, assembler = summary or Summary(), driver.init_state(parts.seed), Assembler()
    controls, emotions, requests = Controls(avatar=""), EmotionControl(), RequestControl()
    with _running(parts):
        start_ns = clock.now_ns()
        live = source.info.duration_ns is None
        wake_ns = due_ns = start_ns + NS // FPS  # no frame can be complete before
        while not source.exhausted:
            if parts.realtime:
                clock.sleep_until_ns(wake_ns)
            if parts.panel:
                controls = parts.panel.read()
                if controls.closed:
                    break
                if parts.view:
                    parts.view.show(controls.avatar)
            with stages("tick"):
                with stages("assemble"):
                    polled = emotions.inject_emotion(source.poll(), controls.emotion)
                    for packet in requests.inject_requests(polled, controls):
                        heard = muted(packet) if controls.muted else packet
                        if parts.record:
                            parts.record(heard)
                        assembler.push(heard)
                    frames = assembler.ready()
                for frame in frames:
                    driven, state = driver.step(frame, state, stages)
                    code_ns = clock.now_ns()
                    summary.frames += 1
                    newest = frame is frames[-1] or not parts.realtime  # a fast replay draws all
                    summary.dropped += not newest
                    picture = parts.view.draw(driven, stages) if parts.view and newest else None
                    with stages("sinks"):
                        result = FrameResult(frame, driven, picture, summary.dropped, code_ns)
                        for sink in parts.sinks:
                            sink.on_frame(result)
            if not frames:
                stages.undo("assemble", "tick")  # a poll without a frame is no tick
                wake_ns = clock.now_ns() + NS // 1000
                continue
            summary.late_ns = max(summary.late_ns, clock.now_ns() - due_ns - NS // FPS)
            # The sample count is the clock of a live run: its frames carry the time of their end.
            end_ns = frames[-1].t_ns if live else start_ns + summary.frames * NS // FPS
            wake_ns = due_ns = min(end_ns, clock.now_ns()) + NS // FPS  # no far future
    return summary


@contextmanager
def _running(parts: Drive) -> Generator[None]:
    """Everything open and no garbage collection; everything closed again, whatever happens."""
    opened: list[Sink] = []
    collecting = gc.isenabled()
    try:
        if parts.view:
            parts.view.warm_up()
        for sink in parts.sinks:
            sink.on_start(parts.info)
            opened.append(sink)
        gc.collect()
        gc.freeze()
        gc.disable()
        parts.source.open()
        yield
    finally:
        if collecting:
            gc.enable()
        gc.unfreeze()
        view = [parts.view] if parts.view else []
        _close([parts.source, *opened, *parts.ports, parts.driver, *view])


def _close(parts: Sequence[Closable]) -> None:
    """Close every part even when one fails; the first failure is raised at the end."""
    failures: list[BaseException] = []
    for part in parts:
        try:
            part.close()
        except BaseException as error:  # also a Ctrl-C meanwhile
            failures.append(error)
    if failures:
        raise failures[0]
