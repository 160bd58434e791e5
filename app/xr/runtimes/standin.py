"""A runtime without a headset, for tests and benchmarks: it asks for frames, moves a head, comes
and goes. It speaks the calls of app/xr/runtimes/protocol.py and nothing of OpenXR.
"""

from collections.abc import Callable
from math import cos, pi, radians, sin, tan
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from app.xr.runtimes.protocol import (
    XYZW,
    Eye,
    Frame,
    HeadReading,
    NoRuntimeError,
    SessionEndedError,
    SessionLostError,
)
from sensors.rotation import Vector
from sensors.types import NS, Clock

if TYPE_CHECKING:
    import moderngl

    from render.gl.contexts import GLContext

SIZE = (1024, 1024)  # px an eye
HALF_EYES_M = 0.0315
OUTER, INNER, UP = (tan(radians(degrees)) for degrees in (50.0, 42.0, 47.0))
TANGENTS = ((OUTER, INNER, UP, UP), (INNER, OUTER, UP, UP))
HEIGHT_M = 1.6
PERIOD_S = 4.0  # of the head's motion


class StandInRuntime:
    """Anything about it may be changed while it runs."""

    def __init__(
        self,
        clock: Clock,
        *,
        context: "GLContext | None" = None,  # None: poses alone
        size: tuple[int, int] = SIZE,
        hz: int = 90,  # 0: as fast as frames are drawn
        is_there: Callable[[], bool] = lambda: True,
    ) -> None:
        self.clock, self.context, self.size, self.hz = clock, context, size, hz
        self.is_there = is_there
        self.lost = self.ended = False  # this session: the runtime, the wearer has ended it
        self.focused = True
        self.recentred = 0
        self.gaze: Vector | None = None
        self.face: tuple[float, ...] | None = None
        self.opened = self.ended_frames = 0
        self.targets: list[moderngl.Framebuffer] = []
        self.eyes: tuple[Eye, Eye] | None = None  # of the newest frame

    def open(self) -> "StandInSession":
        if not self.is_there():
            raise NoRuntimeError("xr: expected the runtime for tests, got none; start it")
        self.lost, self.opened = False, self.opened + 1
        if self.context is not None and not self.targets:
            self.context.activate()
            gl = self.context.gl
            self.targets = [gl.framebuffer([gl.texture(self.size, 4)]) for _ in range(2)]
        return StandInSession(self)

    def pictures(self) -> list[NDArray[np.uint8]]:
        """What both eyes see [H, W, 4], top row first."""
        assert self.context is not None
        self.context.activate()
        width, height = self.size
        read = (target.read(components=4, alignment=4) for target in self.targets)
        return [np.frombuffer(p, np.uint8).reshape(height, width, 4)[::-1] for p in read]


class StandInSession:
    def __init__(self, runtime: StandInRuntime) -> None:
        self.name, self.size, self.context = "stand-in", runtime.size, runtime.context
        self._runtime, self._clock = runtime, runtime.clock
        self._next_ns = self._clock.now_ns()

    @property
    def state(self) -> str:
        return "focused" if self._runtime.focused else "visible"

    @property
    def recentred(self) -> int:
        return self._runtime.recentred

    def showing(self) -> bool:
        self._check()
        return self._runtime.focused

    def wait_frame(self) -> Frame:
        self._check()
        runtime, now_ns = self._runtime, self._clock.now_ns()
        period_ns = NS // runtime.hz if runtime.hz else 0
        if period_ns:
            late = max(0, -(-(now_ns - self._next_ns) // period_ns))
            self._next_ns += late * period_ns  # a late frame waits for the next place
            self._clock.sleep_until_ns(self._next_ns)
            self._next_ns += period_ns
        position, xyzw = motion(self._clock.now_ns() + period_ns)
        runtime.eyes = eyes_of(position, xyzw)
        return Frame(runtime.eyes, period_ns)

    def target(self, eye: int) -> "moderngl.Framebuffer":
        return self._runtime.targets[eye]

    def end_frame(self) -> None:
        self._check()
        self._runtime.ended_frames += 1

    def head(self) -> HeadReading | None:
        self._check()
        now_ns = self._clock.now_ns()
        return HeadReading(now_ns, *motion(now_ns), True, self._runtime.gaze, self._runtime.face)

    def close(self) -> None: ...

    def _check(self) -> None:
        if self._runtime.ended:
            raise SessionEndedError("the session was ended in the headset")
        if self._runtime.lost or not self._runtime.is_there():
            raise SessionLostError("the runtime has gone")


def motion(t_ns: int) -> tuple[Vector, XYZW]:
    """A person who stands, sways and looks about: position m, quaternion xyzw."""
    angle = 2 * pi * (t_ns % int(PERIOD_S * NS)) / (PERIOD_S * NS)
    half_yaw = radians(6.0) * sin(angle) / 2
    return (0.03 * sin(angle), HEIGHT_M, 0.0), (0.0, sin(half_yaw), 0.0, cos(half_yaw))


def eyes_of(position: Vector, xyzw: XYZW) -> tuple[Eye, Eye]:
    """Both eyes of a level head."""
    _, y, _, w = xyzw
    right = (1 - 2 * y * y, 0.0, -2 * w * y)
    x0, y0, z0 = position
    eyes = (
        Eye((x0 + side * right[0], y0, z0 + side * right[2]), xyzw, tangents)
        for side, tangents in zip((-HALF_EYES_M, HALF_EYES_M), TANGENTS, strict=True)
    )
    left_eye, right_eye = eyes
    return left_eye, right_eye
