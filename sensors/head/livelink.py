"""Live Link Face: the head's angles in an iPhone's packets (UDP, version 6) and in its CSV files.

A packet: version u8; device and subject, texts with an i32 length; frame i32, share of it f32,
frames a second as two i32; the number of values u8, f32 values; all big-endian. Values 52 to 54 are
yaw, pitch and roll in rad, in Unity's sense: yaw to the subject's right, pitch down, roll to the
subject's left shoulder. The eyes' angles, 55 to 60, have the same sense. There is no position.
"""

import struct
from collections.abc import Iterator
from pathlib import Path

from sensors import livelink_table, rotation
from sensors.head.gate import Reading
from sensors.rotation import Quat
from sensors.types import NS, HeadPacket, HeadPose

PORT = 11111
MAX_DATAGRAM = 2048  # bytes
VERSION = 6
HEAD = slice(52, 55)  # yaw, pitch, roll
NUM_VALUES = 61
MAX_TEXT = 256  # bytes
ANGLES = ("HeadYaw", "HeadPitch", "HeadRoll")  # columns of a table
MAX_ANGLE = 1e3  # rad


def quaternion(yaw: float, pitch: float, roll: float) -> Quat:
    """Angles of a packet, rad -> our rotation; zeros where they are none."""
    if not all(abs(angle) < MAX_ANGLE for angle in (yaw, pitch, roll)):
        return (0.0, 0.0, 0.0, 0.0)
    return rotation.from_angles((pitch, -yaw, -roll))


def angles(pose: HeadPose) -> tuple[float, float, float]:
    """Our rotation -> yaw, pitch, roll of a packet, rad."""
    pitch, yaw, roll = rotation.to_angles(pose.quat)
    return -yaw, pitch, -roll


def decode(datagram: bytes) -> list[Reading]:
    """The reading of a packet; none where it is no packet of a face."""
    try:
        place = _after_text(datagram, 1)
        place = _after_text(datagram, place)
        frame, share, rate, base, count = struct.unpack_from(">ifiiB", datagram, place)
        values = struct.unpack_from(f">{NUM_VALUES}f", datagram, place + 17)
    except (struct.error, ValueError):
        return []
    if datagram[0] != VERSION or count != NUM_VALUES:
        return []
    time_s = (frame + share) * base / rate if rate > 0 else None
    return [Reading((0.0, 0.0, 0.0), quaternion(*values[HEAD]), time_s)]


def read_csv(path: Path) -> Iterator[HeadPacket]:
    """Poses of a take, from 0 ns on; raise InputError where it is none."""
    table = livelink_table.read(path, ANGLES)
    for time_s, turn in zip(table.times.tolist(), table.values.tolist(), strict=True):
        try:
            pose = rotation.checked((0.0, 0.0, 0.0), quaternion(*turn))
        except ValueError:
            continue
        if time_s >= 0:
            yield HeadPacket(round(time_s * NS), pose)


def _after_text(datagram: bytes, place: int) -> int:
    (length,) = struct.unpack_from(">i", datagram, place)
    if not 0 <= length <= MAX_TEXT:
        raise ValueError(length)
    return place + 4 + length
