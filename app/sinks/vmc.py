"""VMC protocol: 52 blendshapes with Apple's names and two eye bones, for VTuber programs.

Eye bones turn in Unity's frame (left-handed; a positive yaw is to the character's right, a positive
pitch is down). Their positions are zero: receivers keep the position of their own avatar.
"""

import numpy as np
from numpy.typing import NDArray

from app.sinks.arkit import ARKIT_NAMES
from app.sinks.face import Face
from app.sinks.osc import Message, OscBundles
from sensors.types import NS

PORT = 39539


class VmcEncoder:
    """Faces as datagrams."""

    def __init__(self) -> None:
        messages: list[Message] = [
            ("/VMC/Ext/OK", (1,), 0),
            ("/VMC/Ext/T", (), 1),
            ("/VMC/Ext/Bone/Pos", ("LeftEye",), 7),
            ("/VMC/Ext/Bone/Pos", ("RightEye",), 7),
        ]
        # The names of perfect-sync avatars start with a capital.
        names = [name[0].upper() + name[1:] for name in ARKIT_NAMES]
        messages += [("/VMC/Ext/Blend/Val", (name,), 1) for name in names]
        self._bundles = OscBundles([*messages, ("/VMC/Ext/Blend/Apply", (), 0)])

    def __call__(self, face: Face) -> list[bytes]:
        time_s = np.float32(face.t_ns % (86_400 * NS) / NS)
        eyes = [np.concatenate([np.zeros(3), unity_turn(yaw, up)]) for yaw, up in face.angles]
        return self._bundles.fill(np.concatenate([[time_s], *eyes, face.arkit], dtype=np.float32))


def unity_turn(yaw: float, up: float) -> NDArray[np.float64]:
    """Quaternion xyzw of an eye that looks `yaw` rad to its owner's left and `up` rad upwards."""
    (cy, cp), (sy, sp) = np.cos([-yaw / 2, -up / 2]), np.sin([-yaw / 2, -up / 2])
    return np.array([cy * sp, sy * cp, -sy * sp, cy * cp])
