"""Readings of a tracker -> checked HeadPackets; bad readings are counted and dropped.

Flow: datagram -> decoder -> Reading -> ReadingGate -> HeadPacket -> HeadSource.poll. A sender may
flood, send NaN or a quaternion of zeros, jump, and has a clock of its own.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import isfinite

from sensors import rotation
from sensors.clock_map import ClockMap
from sensors.rotation import Quat, Vector
from sensors.types import NS, HeadPacket, HeadPose, check_face

MAX_HZ = 250  # poses a second that are kept
BURST = 16  # poses that may come at once
SPEED_RAD, SPEED_MM = 17.0, 4000.0  # a second; heads turn at up to 800 degrees a second
STEP_RAD, STEP_MM = 0.25, 60.0  # tolerance on top of that
STEP_NS = 60_000_000  # poses further apart may be no further away
JUMP_WAIT_NS = 250_000_000  # a jump that lasts is where the head is now
LONG_NS = NS // 2  # after a pause of this length any pose is accepted
MAX_DEVICE_S = 1e9
NEW_CLOCK_S = 0.5  # a sender whose clock is set back by more has started anew


@dataclass(frozen=True)
class Reading:
    """The pose of one message, in our axes (sensors/rotation.py); not yet checked."""

    position: Vector  # mm
    quat: Quat  # wxyz
    device_s: float | None = None  # the sender's own clock
    tracked: bool = True
    gaze: Vector | None = None  # a direction in the head
    face: Sequence[float] | None = None  # [70] weights of the headset's own face tracking


@dataclass
class ReadingCounts:
    """Counts of readings by outcome."""

    poses: int = 0  # passed on
    bad: int = 0  # not finite, or no rotation
    jumps: int = 0  # too far from the pose before
    flooded: int = 0  # more than MAX_HZ a second
    clock_jumps: int = 0  # times that the sender's clock was set anew


class ReadingGate:
    """Checks the readings of one sender, in order of arrival."""

    def __init__(self, name: str, tell: Callable[[str], None]) -> None:
        """`tell` gets one line the first time that something is dropped for a new reason."""
        self.counts = ReadingCounts()
        self._name, self._tell = name, tell
        self._told = set[str]()
        self._map = ClockMap()
        self._last: HeadPacket | None = None
        self._arrived_ns = 0  # arrival of the last pose that passed
        self._sent_s: float | None = None  # its time by the sender's clock
        self._clock_s = float("-inf")  # of the sender, when it last told
        self._elsewhere: tuple[int, HeadPose] | None = None  # arrival of the first pose that jumped
        self._credit, self._credit_ns = float(BURST), 0

    def __call__(self, reading: Reading, arrival_ns: int) -> HeadPacket | None:
        """The packet of a reading; None where it is dropped."""
        if not self._within_rate(arrival_ns):
            return self._drop("flooded", f"at most {MAX_HZ} poses a second", "more")
        try:
            pose = rotation.checked(reading.position, reading.quat)
            gaze = None if reading.gaze is None else rotation.direction(reading.gaze)
            face = None if reading.face is None else check_face(reading.face)
        except (ValueError, OverflowError) as error:
            return self._drop("bad", "a finite position and a rotation", str(error))
        if self._has_jumped(pose, reading.device_s, arrival_ns):
            return self._drop("jumps", "a head that moves", "one that jumps")
        t_ns = self._time(reading.device_s, arrival_ns)
        self._last = HeadPacket(t_ns, pose, reading.tracked, gaze, face)
        self._arrived_ns, self._sent_s = arrival_ns, reading.device_s
        self.counts.poses += 1
        return self._last

    def _within_rate(self, arrival_ns: int) -> bool:
        gained = (arrival_ns - self._credit_ns) * MAX_HZ / NS
        self._credit = min(self._credit + gained, float(BURST))
        self._credit_ns = arrival_ns
        if self._credit < 1:
            return False
        self._credit -= 1
        return True

    def _has_jumped(self, pose: HeadPose, device_s: float | None, arrival_ns: int) -> bool:
        before = self._last
        since_ns = arrival_ns - self._arrived_ns
        moving_ns = max(since_ns, self._sent_ns(device_s))  # late poses arrive at once
        if before is None or since_ns > LONG_NS or _is_near(before.pose, pose, moving_ns):
            self._elsewhere = None
            return False
        began_ns, there = self._elsewhere or (arrival_ns, pose)
        if not _is_near(there, pose, 0):
            began_ns = arrival_ns
        self._elsewhere = (began_ns, pose)
        if arrival_ns - began_ns < JUMP_WAIT_NS:
            return True
        self._elsewhere = None
        return False

    def _sent_ns(self, device_s: float | None) -> int:
        """Time since the last pose that passed, by the sender's clock; 0 where it tells none."""
        if device_s is None or self._sent_s is None:
            return 0
        since_s = device_s - self._sent_s
        return round(min(since_s, STEP_NS / NS) * NS) if since_s > 0 else 0

    def _time(self, device_s: float | None, arrival_ns: int) -> int:
        """Our time of the sender's; the arrival where the sender's says nothing."""
        t_ns = arrival_ns
        if device_s is not None and isfinite(device_s) and abs(device_s) < MAX_DEVICE_S:
            if device_s < self._clock_s - NEW_CLOCK_S:
                self._map = ClockMap()
                self.counts.clock_jumps += 1
            self._clock_s = device_s
            t_ns = min(self._map.update(round(device_s * NS), arrival_ns), arrival_ns)
            self.counts.clock_jumps += self._map.jump_ns != 0
        return max(t_ns, self._last.t_ns) if self._last else t_ns

    def _drop(self, kind: str, expected: str, got: str) -> None:
        setattr(self.counts, kind, getattr(self.counts, kind) + 1)
        if kind not in self._told:
            self._told.add(kind)
            self._tell(
                f"{self._name}: expected {expected}, got {got}; "
                "these are left out and counted, and not told again"
            )


def _is_near(a: HeadPose, b: HeadPose, since_ns: int) -> bool:
    """Whether a head can get from one to the other in this time."""
    seconds = min(since_ns, STEP_NS) / NS
    way = max(abs(x - y) for x, y in zip(a.position, b.position, strict=True))
    turn = rotation.angle_between(a.quat, b.quat)
    return way <= STEP_MM + SPEED_MM * seconds and turn <= STEP_RAD + SPEED_RAD * seconds
