"""Packets of VMC programs, trackers and iPhones: what is read, and that nothing breaks on junk."""

import struct
from math import degrees
from pathlib import Path

import numpy as np
import pytest
from head_packets import bone, osc, pose

from sensors import rotation
from sensors.head import livelink, vmc
from sensors.types import InputError

FORWARD = (0.0, 0.0, 1.0)


def test_head_and_neck_bones_add_up() -> None:
    neck, head = pose(5, 10, 0), pose(-3, 20, 4)
    datagram = osc((vmc.OK, 1), (vmc.TIME, 12.5), bone("Neck", neck), bone("Head", head))
    (reading,) = vmc.VmcDecoder()(datagram)
    assert rotation.angle_between(reading.quat, rotation.multiply(neck.quat, head.quat)) < 1e-5
    assert reading.position == pytest.approx(head.position, abs=1e-3)
    assert reading.device_s == 12.5 and reading.tracked


def test_a_time_is_that_of_one_pose() -> None:
    """Red before: one time at the start made all later poses as old as it."""
    decode = vmc.VmcDecoder()
    times = [decode(osc(bone("Head", pose(0, 0, 0))))[0].device_s for _ in range(2)]
    assert decode(osc((vmc.TIME, 12.5))) == [] and times == [None, None]
    times = [decode(osc(bone("Head", pose(0, 0, 0))))[0].device_s for _ in range(2)]
    assert times == [12.5, None]


def test_the_headset_wins_over_the_bones_and_a_program_says_that_it_lost_it() -> None:
    decode = vmc.VmcDecoder()
    hmd = (vmc.HMD, "x", *bone("", pose(1, 2, 3))[2:])
    (reading,) = decode(osc(bone("Head", pose(0, 0, 0)), hmd, (vmc.OK, 0)))
    assert rotation.angle_between(reading.quat, pose(1, 2, 3).quat) < 1e-5
    assert decode(osc(bone("Head", pose(0, 0, 0)))) == []
    (reading,) = decode(osc(hmd))
    assert not reading.tracked


@pytest.mark.parametrize(
    "values",
    [
        ("Head",),
        ("Head", *[0.0] * 6),
        ("Head", *[0.0] * 7),
        ("Head", *[float("nan")] * 7),
        ("Head", "x"),
    ],
)
def test_a_bone_that_is_no_pose_is_read_as_bad(values: tuple[str | float, ...]) -> None:
    (reading,) = vmc.VmcDecoder()(osc((vmc.BONE, *values)))
    with pytest.raises(ValueError):
        rotation.checked(reading.position, reading.quat)


def test_trackers_send_degrees_of_unity() -> None:
    decode = vmc.TrackerDecoder()
    decode(osc((vmc.TRACKER + "position", 0.001, 0.002, 0.003)))
    (reading,) = decode(osc((vmc.TRACKER + "rotation", 10.0, 30.0, 0.0)))  # down, to the right
    assert reading.position == pytest.approx((-1, 2, 3), abs=1e-3)
    ahead = rotation.rotate(reading.quat, FORWARD)
    assert degrees(np.arcsin(ahead[1])) == pytest.approx(-10, abs=1e-3)
    assert degrees(np.arctan2(ahead[0], ahead[2])) == pytest.approx(-30, abs=1e-3)


def phone(values: list[float], frame: int = 90, rate: int = 60) -> bytes:
    name = b"phone"
    head = struct.pack(">B", 6) + struct.pack(">i", 5) + name + struct.pack(">i", 5) + name
    return head + struct.pack(">ifiiB", frame, 0.5, rate, 1, 61) + struct.pack(">61f", *values)


def test_a_phone_sends_yaw_pitch_and_roll() -> None:
    wanted = pose(-5, 12, 3)
    (reading,) = livelink.decode(phone([0.0] * 52 + [*livelink.angles(wanted)] + [0.0] * 6))
    assert rotation.angle_between(reading.quat, wanted.quat) < 1e-5
    assert reading.device_s == pytest.approx(90.5 / 60)
    right = livelink.decode(phone([0.0] * 52 + [0.5, 0.0, 0.0] + [0.0] * 6))[0]
    assert rotation.rotate(right.quat, FORWARD)[0] < 0


def test_junk_is_no_reading() -> None:
    rng, whole = np.random.default_rng(0), phone([0.0] * 61)
    for _ in range(300):
        data = bytearray(whole[: rng.integers(len(whole))] + rng.bytes(int(rng.integers(8))))
        for at in rng.integers(max(len(data), 1), size=6):
            data[at : at + 1] = rng.bytes(1)
        for decode in (livelink.decode, vmc.VmcDecoder(), vmc.TrackerDecoder()):
            decode(bytes(data))


def take(folder: Path, *rows: str) -> Path:
    path = folder / "take.csv"
    path.write_text("\n".join(["Timecode,BlendShapeCount,HeadYaw,HeadPitch,HeadRoll", *rows, ""]))
    return path


def test_a_take_is_read(tmp_path: Path) -> None:
    rows = ("10:00:00:00.0,61,0.1,0,0", "10:00:00:29.5,61,nan,0,0", "10:00:01:15.0,61,0,0.2,0")
    first, last = livelink.read_csv(take(tmp_path, *rows))
    assert (first.t_ns, last.t_ns) == (0, 1_500_000_000)
    assert livelink.angles(last.pose) == pytest.approx((0, 0.2, 0), abs=1e-9)


def test_rows_without_a_face_are_left_out_by_both_spellings(tmp_path: Path) -> None:
    """Red before: by `BlendshapeCount` they were taken for a face at rest."""
    path = take(tmp_path, "10:00:00:00.0,61,0.1,0,0", "10:00:00:10.0,0,0,0,0")
    assert len(list(livelink.read_csv(path))) == 1
    path.write_text(path.read_text().replace("BlendShape", "Blendshape"))
    assert len(list(livelink.read_csv(path))) == 1


def test_a_take_over_midnight_goes_on(tmp_path: Path) -> None:
    """Red before: what came after midnight was left out, without a word."""
    rows = ("23:59:59:15.0,61,0.1,0,0", "23:59:59:29.0,61,0.1,0,0", "00:00:00:15.0,61,0,0.2,0")
    *_, last = livelink.read_csv(take(tmp_path, *rows))
    assert last.t_ns == 1_000_000_000


@pytest.mark.parametrize("row", ["x,61,0,0,0", "10:00:00:00.0,61,0", "10:00:00:00.0,61,a,b,c"])
def test_a_damaged_take_is_said_in_a_line(tmp_path: Path, row: str) -> None:
    with pytest.raises(InputError, match="line 2"):
        list(livelink.read_csv(take(tmp_path, row)))
    bad = tmp_path / "bad.csv"
    bad.write_text("a,b\n1,2\n")
    with pytest.raises(InputError, match="HeadYaw"):
        list(livelink.read_csv(bad))
