"""VMC and VRChat-style trackers: OSC messages -> readings of the head.

VMC: `/VMC/Ext/Bone/Pos Head x y z qx qy qz qw`, relative to the bone before it, so that of `Neck`
counts, too; `/VMC/Ext/Hmd/Pos` is the head in the room and wins once it has come. Trackers:
`/tracking/trackers/head/position` and `.../rotation`, metres and Euler angles in degrees.
"""

from collections.abc import Sequence
from math import radians

from sensors import osc, rotation
from sensors.head.gate import Reading
from sensors.rotation import UNIT, Quat, Vector

MAX_DATAGRAM = 8192  # bytes
BONE, HMD = "/VMC/Ext/Bone/Pos", "/VMC/Ext/Hmd/Pos"
TIME, OK = "/VMC/Ext/T", "/VMC/Ext/OK"
TRACKER = "/tracking/trackers/head/"
BONES = ("Neck", "Head")
NAN = float("nan")
BAD = Reading((NAN, NAN, NAN), UNIT)


class VmcDecoder:
    """Datagrams of one sender."""

    def __init__(self) -> None:
        self._time_s: float | None = None
        self._tracked = True
        self._neck: Quat = UNIT
        self._has_hmd = False

    def __call__(self, datagram: bytes) -> list[Reading]:
        """The newest reading of a datagram, or None."""
        found: Reading | None = None
        for message in osc.messages(datagram):
            address = osc.address(message)
            if address not in (BONE, HMD, TIME, OK):
                continue
            values = osc.values(message)
            if values:
                found = self._read(address, values) or found
        return [found] if found else []

    def _read(self, address: str, values: list[osc.Value]) -> Reading | None:
        if address == OK:
            self._tracked = values[0] != 0
            return None
        if address == TIME:
            self._time_s = values[0] if isinstance(values[0], float) else None
            return None
        name, numbers = values[0], _floats(values[1:8])
        is_hmd = address == HMD
        if not is_hmd and (name not in BONES or (self._has_hmd and name == "Head")):
            return None
        if len(numbers) < 7:
            return BAD
        try:
            pose = rotation.from_unity(numbers[:3], numbers[3:])
        except (ValueError, OverflowError):
            return BAD
        if name == "Neck" and not is_hmd:
            self._neck = pose.quat
            return None
        self._has_hmd |= is_hmd
        quat = pose.quat if is_hmd else rotation.multiply(self._neck, pose.quat)
        time_s, self._time_s = self._time_s, None  # of one pose
        return Reading(pose.position, quat, time_s, self._tracked)


class TrackerDecoder:
    """Datagrams of one sender; position and rotation may come in messages of their own."""

    def __init__(self) -> None:
        self._position: Vector = (0.0, 0.0, 0.0)
        self._quat: Quat = UNIT

    def __call__(self, datagram: bytes) -> list[Reading]:
        heard = False
        for message in osc.messages(datagram):
            address = osc.address(message)
            if not address.startswith(TRACKER):
                continue
            numbers = _floats((osc.values(message) or [])[:3])
            heard = True
            if len(numbers) < 3:
                return [BAD]
            if address == TRACKER + "position":
                x, y, z = numbers
                self._position = (-1e3 * x, 1e3 * y, 1e3 * z)
            elif address == TRACKER + "rotation":
                pitch, yaw, roll = map(radians, numbers)
                self._quat = _from_unity_angles(pitch, yaw, roll)
        return [Reading(self._position, self._quat)] if heard else []


def _from_unity_angles(pitch: float, yaw: float, roll: float) -> Quat:
    """Angles of Unity's axes, rad; NaN and infinity make a rotation that ReadingGate refuses."""
    if not all(abs(angle) < 1e6 for angle in (pitch, yaw, roll)):
        return (0.0, 0.0, 0.0, 0.0)
    return rotation.from_angles((pitch, -yaw, -roll))


def _floats(values: Sequence[osc.Value]) -> list[float]:
    """Those at the start that are numbers."""
    numbers: list[float] = []
    for value in values:
        if isinstance(value, bool) or not isinstance(value, int | float):
            break
        numbers.append(float(value))
    return numbers
