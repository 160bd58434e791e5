"""The head's pose out by every protocol and back in by ours: within 0.1 degree and 1 mm."""

import csv
from math import degrees, radians
from pathlib import Path

import numpy as np
import pytest

from app.drive.sink import FrameResult, RunInfo
from app.sinks.arkit import ArkitSink
from app.sinks.motion import MotionSink
from app.sinks.protocols.face import FaceReader
from app.sinks.protocols.livelink import LiveLinkEncoder
from app.sinks.protocols.vmc import VmcEncoder
from app.sinks.protocols.vrchat import VRChatEncoder
from encoder.types import DrivenFrame
from render.decoder import identity
from render.decoder.decoder import Decoder
from render.types import AHEAD
from sensors import rotation
from sensors.head import livelink, vmc
from sensors.head.gate import ReadingGate
from sensors.types import HeadPose, SensorFrame

AXES = [(30, 0, 0), (-20, 0, 0), (0, 30, 0), (0, -30, 0), (0, 0, 15), (0, 0, -15), (10, -25, 8)]
SHIFTS = [(5.0, 0.0, 0.0), (0.0, -7.0, 0.0), (0.0, 0.0, 9.0)]
POSES = [
    HeadPose(SHIFTS[k % 3], rotation.from_angles((radians(p), radians(y), radians(r))))
    for k, (p, y, r) in enumerate(AXES)
]


def driven(index: int, pose: HeadPose) -> DrivenFrame:
    return DrivenFrame(index, (index + 1) * 33_333_333, np.zeros(256, np.float32), AHEAD, pose, 0.5)


@pytest.mark.parametrize("pose", POSES)
@pytest.mark.parametrize(
    ("encode", "decode", "has_position"),
    [
        (VmcEncoder(), vmc.VmcDecoder(), True),
        (VRChatEncoder(), vmc.TrackerDecoder(), True),
        (LiveLinkEncoder(), livelink.decode, False),
    ],
    ids=["vmc", "vrchat", "livelink"],
)
def test_there_and_back(decoder, pose, encode, decode, has_position) -> None:  # type: ignore[no-untyped-def]
    gate, back = ReadingGate("test", lambda line: None), None
    for k, datagram in enumerate(encode(FaceReader(decoder)(driven(3, pose)))):
        for reading in decode(datagram):
            back = gate(reading, 10**9 * (k + 1)) or back
    assert back is not None
    assert degrees(rotation.angle_between(back.pose.quat, pose.quat)) <= 0.1
    wanted = pose.position if has_position else (0, 0, 0)
    np.testing.assert_allclose(back.pose.position, wanted, atol=1)


def test_bones_of_vmc_alone_add_up_to_the_head(decoder: Decoder) -> None:
    for pose in POSES:
        decode, back = vmc.VmcDecoder(), None
        for datagram in VmcEncoder()(FaceReader(decoder)(driven(0, pose))):
            bones = datagram.replace(b"/VMC/Ext/Hmd/Pos", b"/VMC/Ext/xxx/Pos")
            back = (decode(bones) or [back])[-1]
        assert back and degrees(rotation.angle_between(back.quat, pose.quat)) <= 0.1


def result(frame: DrivenFrame) -> FrameResult:
    none = np.zeros(2, np.int64)
    sensors = SensorFrame(
        frame.index, frame.t_ns, np.zeros(1600, np.float32), None, none > 0, none, False
    )
    return FrameResult(sensors, frame, None)


def test_tables_and_motion_files_have_the_pose(decoder: Decoder, tmp_path: Path) -> None:
    table, motion = tmp_path / "face.csv", tmp_path / "motion.npz"
    sinks = [ArkitSink(table, decoder), MotionSink(motion, decoder, identity.load("ben"))]
    for sink in sinks:
        sink.on_start(RunInfo(64, 64, len(POSES)))
        for k, pose in enumerate(POSES):
            sink.on_frame(result(driven(k, pose)))
        sink.close()
    with table.open(newline="") as file:
        rows = list(csv.DictReader(file))
    back = list(livelink.read_csv(table))
    with np.load(motion) as kept:
        heads, quats, breath = kept["head_mm"], kept["head_quat"], kept["breath"]
    assert (breath == 0.5).all()
    for k, pose in enumerate(POSES):
        yaw, pitch, roll = livelink.angles(pose)
        told = [float(rows[k][f"Head{name}"]) for name in ("Yaw", "Pitch", "Roll")]
        assert told == pytest.approx([yaw, pitch, roll], abs=1e-6)
        assert degrees(rotation.angle_between(back[k].pose.quat, pose.quat)) <= 0.1
        np.testing.assert_allclose(heads[k], pose.position, atol=1e-4)
        np.testing.assert_allclose(quats[k], pose.quat, atol=1e-6)
