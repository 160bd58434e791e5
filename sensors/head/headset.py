"""A headset's pose as a reading of the head, from OpenXR as from WebXR.

Both tell where the point between the eyes is. A head turns about its joint behind and below them,
so the way of the joint is what counts as the head's position.
"""

from collections.abc import Sequence

from sensors import rotation
from sensors.head.gate import Reading
from sensors.rotation import UNIT
from sensors.types import HeadPose

JOINT_MM = (0.0, -65.0, -85.0)  # from the point between the eyes, in the head's own axes
NAN = float("nan")
BAD = Reading((NAN, NAN, NAN), UNIT)


def reading(
    position: Sequence[float],  # m, in the axes of OpenXR
    xyzw: Sequence[float],
    device_s: float | None = None,  # the headset's own clock
    tracked: bool = True,
    gaze: Sequence[float] | None = None,  # unit, in the head, in the axes of OpenXR
    face: Sequence[float] | None = None,  # [70] weights of XR_FB_face_tracking2
) -> Reading:
    """What is no pose is read as one that ReadingGate refuses."""
    try:
        eyes = rotation.from_xr(position, xyzw)
    except (ValueError, OverflowError):
        return BAD
    pose = joint(eyes)
    aim = None if gaze is None else (-gaze[0], gaze[1], -gaze[2])
    return Reading(pose.position, pose.quat, device_s, tracked, aim, face)


def joint(eyes: HeadPose) -> HeadPose:
    """The pose of the head's joint, from that of the point between the eyes."""
    turned = rotation.rotate(eyes.quat, JOINT_MM)
    x, y, z = (p + t - j for p, t, j in zip(eyes.position, turned, JOINT_MM, strict=True))
    return HeadPose((x, y, z), eyes.quat)
