"""What the headset's loop asks of an OpenXR runtime: a narrow protocol that two modules answer,
openxr.py for real ones and standin.py for tests and benchmarks.

    open -> Session: showing -> wait_frame -> target(left), target(right) -> end_frame
                     head, beside it

Poses are OpenXR's own here: metres in LOCAL space, +x right, +y up, +z backward, quaternions xyzw.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from sensors.rotation import Vector
from sensors.types import InputError

if TYPE_CHECKING:
    import moderngl

    from render.gl.contexts import GLContext
    from render.splats.stereo import Tangents

XYZW = tuple[float, float, float, float]


class NoRuntimeError(InputError):
    """There is nothing to open: no pyopenxr, no runtime, or one that cannot do what is needed."""


class SessionLostError(RuntimeError):
    """This session is over, or none can be had just now: the runtime is gone, the headset is away.
    Another one may be had later."""


class SessionEndedError(RuntimeError):
    """The wearer has ended it; it is not opened again."""


@dataclass(frozen=True)
class Eye:
    """One eye's view at the moment when a frame will be seen."""

    position: Vector  # m
    xyzw: XYZW
    tangents: "Tangents"  # of the view's edges: left, right, up, down


@dataclass(frozen=True)
class Frame:
    """One picture that the runtime asks for."""

    eyes: tuple[Eye, Eye] | None  # left, right; None: nothing is to be drawn
    period_ns: int  # to the next one


@dataclass(frozen=True)
class HeadReading:
    """Where the point between the eyes is now."""

    t_ns: int  # on the system's monotonic clock
    position: Vector  # m
    xyzw: XYZW
    tracked: bool
    gaze: Vector | None = None  # unit, in the head's own OpenXR axes; None: not tracked
    face: tuple[float, ...] | None = None  # [70] 0..1 of XR_FB_face_tracking2; None: not tracked


class Session(Protocol):
    """All methods but `close` raise SessionLostError or SessionEndedError once it is over."""

    name: str  # of the runtime
    size: tuple[int, int]  # px of an eye's picture, width and height
    context: "GLContext | None"  # in which pictures are drawn; None: poses alone

    @property
    def state(self) -> str:
        """As OpenXR names it: idle, ready, synchronized, visible, focused, ..."""
        ...

    @property
    def recentred(self) -> int:
        """How often the wearer has said where "in front" is."""
        ...

    def showing(self) -> bool:
        """Take in what has happened. True: frames are asked for, so `wait_frame` next."""
        ...

    def wait_frame(self) -> Frame:
        """Wait until the runtime wants the next picture. Every frame must be ended."""
        ...

    def target(self, eye: int) -> "moderngl.Framebuffer":
        """What to draw this eye's picture into, of `size`; the lowest row first, as GL has it."""
        ...

    def end_frame(self) -> None:
        """Hand over what was drawn since `wait_frame`, which may be nothing."""
        ...

    def head(self) -> HeadReading | None:
        """The pose of this moment; None where there is none."""
        ...

    def close(self) -> None:
        """May be called at any time, also after a loss."""
        ...


class Runtime(Protocol):
    def open(self) -> Session:
        """Raises NoRuntimeError, or SessionLostError where waiting may help."""
        ...
