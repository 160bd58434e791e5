"""VMC protocol: 52 blendshapes with Apple's names, eyes, neck and head, for VTuber programs.

Bones turn in Unity's frame (left-handed; a positive yaw is to the character's right, a positive
pitch is down), each relative to the bone before it. Their positions are zero: receivers keep the
position of their own avatar. The headset's message has the whole pose of the head.
"""

import numpy as np
from numpy.typing import NDArray

from app.face.arkit import ARKIT_NAMES
from app.sinks.protocols.face import NamedFace
from app.sinks.protocols.osc import Message, OscBundles
from sensors import rotation
from sensors.types import NS, HeadPose

NECK_SHARE = 0.4  # of a turn of the head


class VmcEncoder:
    """Faces as datagrams."""

    def __init__(self) -> None:
        messages = [
            Message("/VMC/Ext/OK", (1,)),
            Message("/VMC/Ext/T", num_floats=1),
            Message("/VMC/Ext/Hmd/Pos", ("livedrive",), 7),
            Message("/VMC/Ext/Bone/Pos", ("Neck",), 7),
            Message("/VMC/Ext/Bone/Pos", ("Head",), 7),
            Message("/VMC/Ext/Bone/Pos", ("LeftEye",), 7),
            Message("/VMC/Ext/Bone/Pos", ("RightEye",), 7),
        ]
        # The names of perfect-sync avatars start with a capital.
        names = [name[0].upper() + name[1:] for name in ARKIT_NAMES]
        messages += [Message("/VMC/Ext/Blend/Val", (name,), 1) for name in names]
        self._bundles = OscBundles([*messages, Message("/VMC/Ext/Blend/Apply")])

    def __call__(self, face: NamedFace) -> list[bytes]:
        time_s = np.float32(face.t_ns % (86_400 * NS) / NS)
        eyes = [np.concatenate([np.zeros(3), unity_turn(yaw, up)]) for yaw, up in face.angles]
        pose = [[time_s], *_pose(face.head), *eyes]
        return self._bundles.fill(np.concatenate([*pose, face.arkit], dtype=np.float32))


def _pose(head: HeadPose) -> list[NDArray[np.float64]]:
    """Positions in metres and quaternions xyzw [7] of the headset, the neck and the head on it."""
    neck = rotation.slerp(rotation.UNIT, head.quat, NECK_SHARE)
    on_neck = rotation.multiply(rotation.inverse(neck), head.quat)
    poses = (head, HeadPose(quat=neck), HeadPose(quat=on_neck))
    return [np.concatenate(rotation.to_unity(pose)) for pose in poses]


def unity_turn(yaw: float, up: float) -> NDArray[np.float64]:
    """Quaternion xyzw of an eye that looks `yaw` rad to its owner's left and `up` rad upwards."""
    (cy, cp), (sy, sp) = np.cos([-yaw / 2, -up / 2]), np.sin([-yaw / 2, -up / 2])
    return np.array([cy * sp, sy * cp, -sy * sp, cy * cp])
