"""XrSink: the loop's end of the headset.

Why the headset is a process and not a thread: OpenXR waits for the display in `wait_frame`, drawing
in stereo holds Python's lock, and a runtime is a library of somebody else that may crash. The
process is started again when it ends by itself. What crosses is a tick of one kilobyte.
"""

import subprocess
import threading
from collections.abc import Callable
from typing import Any

from app.drive.sink import FrameResult, RunInfo
from app.process import child
from app.xr.link import XrInfo, XrMemory
from sensors.types import NS, Clock, InputError

START_S, END_S = 60, 3  # time that a headset has to open, and to close
RESTART_S = 0.5


class XrSink:
    """Shows the driven head in the headset; its `memory` also carries the headset's poses."""

    def __init__(self, info: XrInfo, clock: Clock, tell: Callable[[str], None]) -> None:
        """Starts the headset's process; `on_start` waits for it."""
        self.memory = XrMemory()
        self._info, self._clock, self._tell = info, clock, tell
        self.show({"avatar": info.avatar})
        self._lost, self._crashes = False, 0
        self._closing = threading.Event()
        self._process = self._start()
        self._keeper = threading.Thread(target=self._keep, name="xr", daemon=True)

    def on_start(self, info: RunInfo) -> None:
        status, start_ns = self.memory.status, self._clock.now_ns()
        while not status["ready"]:
            if self._process.poll() is not None:
                raise InputError(self.memory.text("error") or "--xr: the headset's process crashed")
            if self._clock.now_ns() > start_ns + START_S * NS:
                raise InputError(
                    f"--xr: expected a session within {START_S} s, got none; run: livedrive doctor"
                )
            self._clock.sleep_until_ns(self._clock.now_ns() + NS // 100)
        self._keeper.start()

    def on_frame(self, result: FrameResult) -> None:
        driven = result.driven
        self.memory.ticks.post(
            t_ns=driven.t_ns,
            posted_ns=self._clock.now_ns(),
            expression=driven.expression,
            gaze=driven.gaze,
            head=(*driven.head.position, *driven.head.quat, driven.breath),
        )
        problem = self.memory.text("problem")
        if bool(problem) != self._lost:
            self._lost = bool(problem)
            more = "" if self.memory.status["ended"] else "; still looking for it"
            self._tell(f"headset: {problem}{more}" if problem else "headset: is back")

    def picks(self) -> dict[str, Any]:
        """A place of controls that shows and changes nothing."""
        return {}

    def show(self, changed: dict[str, Any]) -> None:
        """Who is drawn, also when the process starts anew."""
        if "avatar" in changed:
            self.memory.status["avatar"] = changed["avatar"].encode()

    def close(self) -> None:
        self.memory.status["ending"] = True
        self._closing.set()
        try:
            self._process.wait(END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if self._keeper.is_alive():
            self._keeper.join()
        self.memory.close()

    def xr_report(self) -> dict[str, Any]:
        """What the headset's process counted."""
        status = self.memory.status
        return {
            "mode": self._info.mode,
            "runtime": self.memory.text("runtime"),
            "problem": self.memory.text("problem"),
            "state": self.memory.text("state"),
            "eye_px": [int(status["width"]), int(status["height"])],
            "frames": int(status["frames"]),
            "poses": int(status["poses"]),
            "losses": int(status["losses"]),
            "crashes": self._crashes,
            "share": float(status["share"]),
            "draw_ms": round(float(status["draw_ms"]), 2),
        }

    @property
    def pid(self) -> int:
        """Of the headset's process."""
        return self._process.pid

    def _start(self) -> "subprocess.Popen[bytes]":
        memories = [self.memory.handle, *([self._info.seats] if self._info.seats else [])]
        return child.start("app.xr", self._info, memories)

    def _keep(self) -> None:
        """Start the process again whenever it ends by itself."""
        status = self.memory.status
        while True:
            given_up = self._process.wait() == 2 and bool(status["error"])
            if given_up:
                status["problem"], status["ended"] = status["error"][:200], True
            if self._closing.is_set() or status["ended"]:
                return
            self._crashes += 1
            status["problem"] = b"its process crashed"
            if self._closing.wait(RESTART_S):
                return
            self._process = self._start()
