"""The types every sensor speaks: packets, frames, sources and clocks.

Flow: device | Recording -> Source.poll -> packets -> Assembler -> SensorFrame -> Driver.
Times are int64 nanoseconds on one monotonic axis; the left eye is index 0. Each 30 FPS frame is
1600 new samples of 48 kHz mono sound plus the newest pair of eye pictures (paper section 3).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

SAMPLE_RATE = 48_000
FPS = 30
SAMPLES_PER_FRAME = 1600
EYE_SIZE = 400
NS = 1_000_000_000
EYE_NAMES = ("left", "right")
LOOPBACK = "127.0.0.1"  # what listens here is reached from this machine alone
FACE_DIM = 70  # weights of XR_FB_face_tracking2, in its order


class InputError(ValueError):
    """Bad input: one line that says what, expected, got, and the next command."""


@dataclass(frozen=True, eq=False)
class AudioPacket:
    """A run of sound as the device delivered it."""

    t_ns: int  # time of the first sample
    first_sample: int  # device counter of the first sample; a jump means lost sound
    samples: NDArray[np.float32]  # [n] -1..1, 48 kHz mono
    gap: bool = False  # True: the source knows that sound before or in this packet was lost


@dataclass(frozen=True, eq=False)
class EyePacket:
    """One picture of one eye as the camera delivered it."""

    t_ns: int
    eye: int  # 0 left, 1 right
    counter: int  # camera frame counter; a jump means lost pictures
    image: NDArray[np.uint8]  # [H, W] infrared, 8-bit mono


@dataclass(frozen=True, eq=False)
class EmotionPacket:
    """From here on the face shall show this, e.g. "happy:0.7"; empty: nothing of its own."""

    t_ns: int
    words: str


Request = Literal["recentre", "reset"]
REQUESTS: tuple[Request, ...] = ("recentre", "reset")


@dataclass(frozen=True, eq=False)
class RequestPacket:
    """Asked for once: what is seen now is straight ahead, or the head starts anew."""

    t_ns: int
    wanted: Request


@dataclass(frozen=True)
class HeadPose:
    """Where a head is: millimetres and a unit quaternion in the axes of the world, +x towards the
    subject's left, +y up, +z forward. Positive turns: about x nods down, about y looks to the
    subject's left, about z tilts towards the subject's right shoulder."""

    position: tuple[float, float, float] = (0.0, 0.0, 0.0)  # mm
    quat: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)  # wxyz


@dataclass(frozen=True)
class HeadPacket:
    """One pose as the tracker delivered it, in the axes of HeadPose and any origin.

    `face` drives nothing: it is recorded, so that ours can be compared with it.
    """

    t_ns: int
    pose: HeadPose
    valid: bool = True  # False: the tracker says itself that it has lost the head
    gaze: tuple[float, float, float] | None = None  # unit, in the head's axes: both eyes' aim
    face: tuple[float, ...] | None = None  # [70] 0..1: XR_FB_face_tracking2


def check_face(weights: Sequence[float]) -> tuple[float, ...]:
    """The weights of a HeadPacket's face, rounded to 1e-4; raise ValueError unless they are."""
    face = tuple(round(float(weight), 4) for weight in weights)
    if len(face) != FACE_DIM or not all(0 <= weight <= 1 for weight in face):
        raise ValueError(f"face: expected {FACE_DIM} weights from 0 to 1, got {len(face)}")
    return face


Packet = AudioPacket | EyePacket | EmotionPacket | RequestPacket | HeadPacket


@dataclass(frozen=True, eq=False)
class SensorFrame:
    """All that one 30 FPS tick may know: nothing in it is later than `t_ns`."""

    index: int
    t_ns: int  # time at the END of its 1600 samples
    audio: NDArray[np.float32]  # [1600] -1..1
    eyes: NDArray[np.uint8] | None  # [2, 400, 400]; None until the first eye picture
    eyes_valid: NDArray[np.bool_]  # [2] picture is fresh enough to be trusted
    eyes_age_ns: NDArray[np.int64]  # [2] t_ns minus the picture's time; -1 where there is none
    audio_gap: bool  # True: some of `audio` is silence put in place of lost sound
    emotion: str = ""  # words of the newest EmotionPacket
    head: HeadPose | None = None  # newest pose; None until the first
    head_valid: bool = False  # that pose is fresh enough to be trusted
    head_age_ns: int = -1  # t_ns minus the pose's time; -1 where there is none
    gaze: tuple[float, float, float] | None = None  # that came with a valid pose; unit, in the head
    requests: tuple[Request, ...] = ()  # done before this frame is driven, in their order


@dataclass(frozen=True)
class SourceInfo:
    """What a source is and which streams it carries."""

    name: str
    audio: bool = True
    eyes: tuple[int, ...] = ()  # the eye indices it can deliver
    head: bool = False
    duration_ns: int | None = None  # None: live, unknown length
    num_frames: int | None = None  # whole frames that its sound makes; None: unknown
    devices: Mapping[str, str] = field(default_factory=dict[str, str])  # stream -> device name


class Source(Protocol):
    """Anything that yields packets: a device, a recording, a synthetic signal."""

    @property
    def info(self) -> SourceInfo: ...

    @property
    def exhausted(self) -> bool:
        """True once `poll` will never return a packet again."""
        ...

    @property
    def dropped(self) -> int:
        """Packets known to be lost since `open`."""
        ...

    def open(self) -> None: ...

    def poll(self) -> list[Packet]:
        """Return what arrived since the last call, in order, in device time; never block."""
        ...

    def close(self) -> None:
        """Release the device; calling it twice is harmless."""
        ...


class Clock(Protocol):
    """Where time comes from. Live code and tests differ only in the clock they are given."""

    def now_ns(self) -> int: ...

    def sleep_until_ns(self, t_ns: int) -> None: ...
