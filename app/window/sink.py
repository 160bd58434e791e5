"""WindowSink: the loop's end of the window.

Why the window is a process and not a thread: an OpenGL call of moderngl holds Python's lock until
it is done, and a swap of buffers waits for the display. A window in a thread of the loop would stop
the tick with every picture; a process cannot, not even when it hangs or crashes. It also decodes
and draws on the other core, at the display's own rate, with motion between the ticks. What crosses
is a tick of 320 kB, in shared memory.
"""

import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from app.drive.controls import Controls
from app.drive.sink import FrameResult, RunInfo
from app.process import child
from app.window.state import picks
from app.window.state.shared import SharedMemory, WindowInfo
from sensors.types import NS, Clock, InputError

START_S, END_S = 120, 3  # patience with a window that compiles and opens, or closes


class PanelTape(Protocol):
    """What the record button starts and stops."""

    wanted: bool

    @property
    def failed(self) -> bool: ...
    def apply(self, wanted: Controls) -> None: ...


class WindowSink:
    """Shows the driven head, and is where a person controls the run."""

    def __init__(
        self,
        info: WindowInfo,
        clock: Clock,
        stage_ms: Callable[[], list[float]],  # what the tick before cost, in the order of STAGES
        tape: PanelTape | None = None,  # what the record button starts and stops
    ) -> None:
        """Starts to open the window; `on_start` waits for it."""
        self._info, self._clock, self._stage_ms, self._tape = info, clock, stage_ms, tape
        self._memory = SharedMemory()
        self._memory.controls["avatar"] = info.avatars.index(info.avatar)
        self._memory.controls["recording"] = tape is not None and tape.wanted
        picks.write(self._memory.controls, info, {"emotion": info.emotion})
        self._before = picks.read(self._memory.controls, info)
        memories = [self._memory.handle, *([info.seats] if info.seats else [])]
        self._process = child.start("app.window", info, memories)
        self._crashed = False

    def on_start(self, info: RunInfo) -> None:
        controls, start_ns = self._memory.controls, self._clock.now_ns()
        while not controls["ready"]:
            if self._process.poll() is not None:
                reason = bytes(controls["error"]).decode() or "the window process crashed"
                raise InputError(f"--window: {reason}; `livedrive run --headless` needs no screen")
            if self._clock.now_ns() > start_ns + START_S * NS:
                raise InputError(
                    f"--window: expected a window within {START_S} s, got none; "
                    "run: livedrive doctor"
                )
            self._clock.sleep_until_ns(self._clock.now_ns() + NS // 100)

    def on_frame(self, result: FrameResult) -> None:
        sensors, driven = result.sensors, result.driven
        sound = np.nan_to_num(sensors.audio)
        empty = sensors.eyes is None
        self._memory.ticks.post(
            index=driven.index,
            t_ns=driven.t_ns,
            posted_ns=self._clock.now_ns(),
            expression=driven.expression,
            gaze=driven.gaze,
            head=(*driven.head.position, *driven.head.quat, driven.breath),
            level=(np.sqrt(np.mean(sound * sound)), np.abs(sound).max()),
            audio_gap=sensors.audio_gap,
            eyes_valid=sensors.eyes_valid,
            eyes_age_ms=np.where(sensors.eyes_age_ns < 0, -1, sensors.eyes_age_ns / 1e6),
            eyes=0 if empty else sensors.eyes,
            eye_frames=0 if driven.eye_frames is None else driven.eye_frames,
            stage_ms=self._stage_ms(),
            dropped=result.dropped,
        )

    def read(self) -> Controls:
        """What the person at the window asks for. A crashed window asks for nothing new."""
        controls = self._memory.controls
        if not self._crashed and not controls["closed"] and self._process.poll() is not None:
            self._crashed = True
            words = "livedrive: the window has crashed; driving goes on, Ctrl-C ends it"
            print(words, file=sys.stderr)
        if self._tape is not None and self._tape.failed:
            controls["recording"] = False  # the button shows it
        wanted = picks.read(controls, self._info)
        if self._tape is not None:
            self._tape.apply(wanted)
        return wanted

    def picks(self) -> dict[str, Any]:
        """What the person there has changed since the last call: fields of Controls."""
        now, before = vars(self.read()), vars(self._before)
        self._before = Controls(**now)
        return {name: value for name, value in now.items() if value != before[name]}

    def show(self, changed: dict[str, Any]) -> None:
        """Controls that were changed elsewhere."""
        picks.write(self._memory.controls, self._info, changed)
        now = vars(picks.read(self._memory.controls, self._info))
        self._before = replace(self._before, **{name: now[name] for name in changed})

    def close(self) -> None:
        self._memory.controls["ending"] = True
        try:
            self._process.wait(END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._memory.close()
