"""Live Link Face: the head's angles in an iPhone's packets (UDP, version 6) and in its CSV files.

A packet: version u8; device and subject, texts with an i32 length; frame i32, share of it f32,
frames a second as two i32; the number of values u8, f32 values; all big-endian. Values 52 to 54 are
yaw, pitch and roll in rad, in Unity's sense: yaw to the subject's right, pitch down, roll to the
subject's left shoulder. The eyes' angles, 55 to 60, have the same sense. There is no position.
"""

import csv
import re
import struct
from collections.abc import Iterator
from pathlib import Path

from sensors import files, rotation
from sensors.head.gate import Reading
from sensors.rotation import Quat
from sensors.types import NS, HeadPacket, HeadPose, InputError

PORT = 11111
MAX_DATAGRAM = 2048  # bytes
VERSION = 6
HEAD = slice(52, 55)  # yaw, pitch, roll
NUM_VALUES = 61
MAX_TEXT = 256  # bytes
TIMECODE = re.compile(r"(\d+):(\d+):(\d+)[:;](\d+)(\.\d+)?")
COLUMNS = ("Timecode", "HeadYaw", "HeadPitch", "HeadRoll")
MAX_ANGLE = 1e3  # rad
DAY_S = 86_400.0


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
    start_s: float | None = None
    rows = list(_rows(path))
    rate = 1 + max((int(frame) for _, frame, *_ in rows), default=0)
    rate = next((r for r in (24, 25, 30, 60) if rate <= r), rate)
    for seconds, frame, *turn in rows:
        time_s = seconds + frame / rate
        start_s = time_s if start_s is None else start_s
        time_s += DAY_S if start_s - time_s > DAY_S / 2 else 0  # a take over midnight
        try:
            pose = rotation.checked((0.0, 0.0, 0.0), quaternion(*turn))
        except ValueError:
            continue
        if time_s >= start_s:
            yield HeadPacket(round((time_s - start_s) * NS), pose)


def _rows(path: Path) -> Iterator[tuple[float, float, float, float, float]]:
    """Seconds, frame in the second, yaw, pitch, roll."""
    # render/arkit.py reads the blendshapes of the same table: neither package imports the other.
    try:
        header, *rows = [*csv.reader(files.read_text(path).splitlines()), list[str]()]
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(
            f"{path}: expected a Live Link Face CSV, got {error}; export the take again"
        ) from None
    header[:1] = [name.removeprefix("\ufeff") for name in header[:1]]
    missing = [name for name in COLUMNS if name not in header]
    if missing:
        raise InputError(
            f"{path}: expected a Live Link Face CSV with {', '.join(COLUMNS)}, got no "
            f"{', '.join(missing)}; export the take again"
        )
    at = [header.index(name) for name in COLUMNS]
    for number, row in enumerate(rows, 2):
        if not row:
            continue
        try:
            time = TIMECODE.fullmatch(row[at[0]])
            if time is None:
                raise ValueError(row[at[0]])
            hours, minutes, seconds, frame = map(int, time.groups()[:4])
            share = float(time[5] or 0)
            turn = tuple(float(row[column]) for column in at[1:])
        except (ValueError, IndexError) as error:
            raise InputError(
                f"{path}: line {number}: expected a timecode and three angles, got {error}; "
                "repair or delete that line"
            ) from None
        yield (3600.0 * hours + 60 * minutes + seconds, frame + share, turn[0], turn[1], turn[2])


def _after_text(datagram: bytes, place: int) -> int:
    (length,) = struct.unpack_from(">i", datagram, place)
    if not 0 <= length <= MAX_TEXT:
        raise ValueError(length)
    return place + 4 + length
