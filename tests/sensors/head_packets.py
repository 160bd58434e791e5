"""Packets of VMC programs and trackers, made with python-osc."""

from math import radians

from sensors import rotation
from sensors.head import vmc
from sensors.standins.osc import bundle as osc
from sensors.types import HeadPose

__all__ = ["bone", "osc", "pose"]


def bone(name: str, pose: HeadPose) -> tuple[str | float, ...]:
    position, xyzw = rotation.to_unity(pose)
    return (vmc.BONE, name, *position, *xyzw)


def pose(pitch: float, yaw: float, roll: float) -> HeadPose:
    turn = rotation.from_angles((radians(pitch), radians(yaw), radians(roll)))
    return HeadPose((3.0, -4.0, 5.0), turn)
