"""The driving loop: packets in, pictures out (DESIGN flow).

    Source.poll -> Assembler -> SensorFrame -> Driver.step -> DrivenFrame
                -> Decoder -> Gaussians -> Renderer -> picture -> sinks

Two rules: a frame exists when its 1600 samples exist, and every frame is stepped. After a stall
the loop steps through all queued frames and draws the newest: it never skips a step, it skips a
draw. Live and replay differ only in the source and the clock that are passed in.
"""

import gc
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from app.controls import ControlPanel, Controls, hushed
from app.emotion import EmotionControl
from app.sinks.sink import FrameResult, RunInfo, Sink
from app.stages import Stages
from encoder.driver import DrivenFrame, Driver, DriverState
from render import identity
from render.decoder import EXPRESSION_DIM, Decoder
from render.identity import Identity
from render.types import AHEAD, Camera, Renderer
from sensors.assemble import Assembler
from sensors.types import FPS, NS, Clock, Packet, Source

if TYPE_CHECKING:
    from render.torch_decoder import TorchDecoder


@dataclass
class Head:
    """What turns a driven frame into a picture."""

    decoder: "Decoder | TorchDecoder"
    identity: Identity
    renderer: Renderer
    camera: Camera


@dataclass
class Summary:
    """What a run did."""

    frames: int = 0  # stepped
    dropped: int = 0  # stepped and not drawn
    late_ns: int = 0  # how far the worst tick ran over its deadline


def drive(
    source: Source,
    driver: Driver,
    head: Head | None,  # None: codes only, nothing is drawn
    sinks: Sequence[Sink],
    clock: Clock,
    stages: Stages,
    info: RunInfo,
    seed: int,
    realtime: bool,
    panel: ControlPanel | None = None,
    emotions: EmotionControl | None = None,
    record: Callable[[Packet], None] | None = None,  # sees what the driver gets, before assembly
) -> Summary:
    """Run until the source is exhausted, the panel is closed or Ctrl-C; sinks are closed anyway."""
    summary, state, assembler = Summary(), driver.init_state(seed), Assembler()
    emotions = emotions or EmotionControl()
    wishes = Controls(avatar="")  # as they were fulfilled
    if head:
        _warm_up(head)
    with _running(source, sinks, info):
        start_ns = clock.now_ns()
        live = source.info.duration_ns is None
        wake_ns = due_ns = start_ns + NS // FPS  # no frame can be complete before
        while not source.exhausted:
            if realtime:
                clock.sleep_until_ns(wake_ns)
            if panel:
                now = panel.read()
                if now.closed:
                    break
                state = _fulfilled(now, wishes, state, driver, head, seed)
                wishes = now
            with stages("tick"):
                with stages("assemble"):
                    for packet in emotions.led(source.poll(), wishes.emotion):
                        heard = hushed(packet) if wishes.muted else packet
                        if record:
                            record(heard)
                        assembler.push(heard)
                    frames = assembler.ready()
                for frame in frames:
                    driven, state = driver.step(frame, state, stages)
                    code_ns = clock.now_ns()
                    summary.frames += 1
                    newest = frame is frames[-1] or not realtime  # without haste, draw them all
                    summary.dropped += not newest
                    picture = _draw(head, driven, stages) if head and newest else None
                    with stages("sinks"):
                        result = FrameResult(frame, driven, picture, summary.dropped, code_ns)
                        for sink in sinks:
                            sink.on_frame(result)
            if not frames:
                stages.undo("assemble", "tick")  # looking in vain is no tick
                wake_ns = clock.now_ns() + NS // 1000
                continue
            summary.late_ns = max(summary.late_ns, clock.now_ns() - due_ns - NS // FPS)
            # The sample count is the clock of a live run: its frames carry the time of their end.
            end_ns = frames[-1].t_ns if live else start_ns + summary.frames * NS // FPS
            wake_ns = due_ns = min(end_ns, clock.now_ns()) + NS // FPS  # never trust a far future
    return summary


def _fulfilled(
    now: Controls,
    before: Controls,
    state: DriverState,
    driver: Driver,
    head: Head | None,
    seed: int,
) -> DriverState:
    if now.resets > before.resets:
        state = driver.init_state(seed)
    if now.recentred > before.recentred:
        state = driver.recentred(state)
    if head and now.avatar != head.identity.name:
        head.identity = identity.load(now.avatar)
    return state


def _warm_up(head: Head) -> None:
    """Draw a face at rest: what is compiled on first use is compiled before the clock starts."""
    _, gaussians = head.decoder.decode(np.zeros(EXPRESSION_DIM, np.float32), AHEAD, head.identity)
    head.renderer.draw(gaussians, head.camera)


def _draw(head: Head, driven: DrivenFrame, stages: Stages) -> NDArray[np.uint8]:
    with stages("decode"):
        _, gaussians = head.decoder.decode(driven.expression, driven.gaze, head.identity)
    with stages("draw"):
        head.renderer.draw(gaussians, head.camera)
    with stages("readback"):
        return head.renderer.read_rgba()


@contextmanager
def _running(source: Source, sinks: Sequence[Sink], info: RunInfo) -> Iterator[None]:
    """Everything open and no garbage collection; everything closed again, whatever happens."""
    opened: list[Sink] = []
    collecting = gc.isenabled()
    try:
        for sink in sinks:
            sink.on_start(info)
            opened.append(sink)
        gc.collect()
        gc.freeze()
        gc.disable()
        source.open()
        yield
    finally:
        if collecting:
            gc.enable()
        gc.unfreeze()
        source.close()
        _close(opened)


def _close(sinks: list[Sink]) -> None:
    """Close every sink even when one fails; the first failure is raised at the end."""
    failures: list[BaseException] = []
    for sink in sinks:
        try:
            sink.close()
        except OSError as error:
            failures.append(error)
    if failures:
        raise failures[0]
