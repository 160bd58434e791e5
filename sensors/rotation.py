"""Rotations of a head as unit quaternions wxyz, and the axes of other systems.

Ours (HeadPose): +x towards the subject's left, +y up, +z forward, millimetres, right-handed.
OpenXR and WebXR: +x right, +y up, +z backward, metres. Unity, VMC and VRChat: +x right, +y up,
+z forward, metres, left-handed.
"""

from collections.abc import Sequence
from math import acos, asin, atan2, cos, isfinite, sin, sqrt

from sensors.types import HeadPose

Quat = tuple[float, float, float, float]  # wxyz
Vector = tuple[float, float, float]
Angles = tuple[float, float, float]  # rad: pitch about x, yaw about y, roll about z

REST = HeadPose()
UNIT: Quat = (1.0, 0.0, 0.0, 0.0)
LENGTHS = (0.5, 2.0)  # of a quaternion that a sender may have rounded
MAX_MM = 1e6
NEAR = 1e-9


def checked(position: Sequence[float], quat: Sequence[float]) -> HeadPose:
    """A pose from elsewhere, with a quaternion of length 1; raise ValueError unless it is one."""
    (x, y, z), (a, b, c, d) = map(float, position), map(float, quat)
    length = sqrt(a * a + b * b + c * c + d * d)
    if not (isfinite(x) and isfinite(y) and isfinite(z) and max(abs(x), abs(y), abs(z)) < MAX_MM):
        raise ValueError(f"position {position}")
    if not LENGTHS[0] <= length <= LENGTHS[1]:
        raise ValueError(f"quaternion {quat}")
    if abs(length - 1) > NEAR:  # what has length 1 stays as it is, to the bit
        a, b, c, d = a / length, b / length, c / length, d / length
    return HeadPose((x, y, z), (a, b, c, d))


def direction(vector: Sequence[float]) -> Vector:
    """A direction from elsewhere, of length 1; raise ValueError unless it is one."""
    x, y, z = map(float, vector)
    length = sqrt(x * x + y * y + z * z)
    if not LENGTHS[0] <= length <= LENGTHS[1]:
        raise ValueError(f"direction {vector}")
    return (x, y, z) if abs(length - 1) <= NEAR else (x / length, y / length, z / length)


def multiply(p: Quat, q: Quat) -> Quat:
    """First q, then p."""
    a, b, c, d = p
    e, f, g, h = q
    return (
        a * e - b * f - c * g - d * h,
        a * f + b * e + c * h - d * g,
        a * g - b * h + c * e + d * f,
        a * h + b * g - c * f + d * e,
    )


def inverse(q: Quat) -> Quat:
    return (q[0], -q[1], -q[2], -q[3])


def rotate(q: Quat, v: Vector) -> Vector:
    _, x, y, z = multiply(multiply(q, (0.0, *v)), inverse(q))
    return (x, y, z)


def slerp(p: Quat, q: Quat, share: float) -> Quat:
    """From p (share 0) to q (share 1) the short way."""
    dot = sum(x * y for x, y in zip(p, q, strict=True))
    sign = -1.0 if dot < 0 else 1.0
    angle = acos(min(abs(dot), 1.0))
    if angle < 1e-6:
        first, second = 1 - share, sign * share
    else:
        first, second = (
            sin((1 - share) * angle) / sin(angle),
            sign * sin(share * angle) / sin(angle),
        )
    w, x, y, z = (first * x + second * y for x, y in zip(p, q, strict=True))
    length = sqrt(w * w + x * x + y * y + z * z)
    return (w / length, x / length, y / length, z / length)


def angle_between(p: Quat, q: Quat) -> float:
    """How far apart two rotations are, rad."""
    _, x, y, z = relative = multiply(inverse(p), q)
    return 2 * atan2(sqrt(x * x + y * y + z * z), abs(relative[0]))


def from_angles(angles: Angles) -> Quat:
    """First roll about z, then pitch about x, then yaw about y (as Unity and VRChat do)."""
    (cx, cy, cz), (sx, sy, sz) = (tuple(f(a / 2) for a in angles) for f in (cos, sin))
    return multiply((cy, 0.0, sy, 0.0), multiply((cx, sx, 0.0, 0.0), (cz, 0.0, 0.0, sz)))


def to_angles(q: Quat) -> Angles:
    """The inverse of `from_angles`; pitch in -90..90 degrees."""
    w, x, y, z = q
    pitch = asin(max(-1.0, min(1.0, 2 * (w * x - y * z))))
    yaw = atan2(2 * (w * y + x * z), 1 - 2 * (x * x + y * y))
    roll = atan2(2 * (w * z + x * y), 1 - 2 * (x * x + z * z))
    return (pitch, yaw, roll)


def from_xr(position: Sequence[float], xyzw: Sequence[float]) -> HeadPose:
    """A pose of OpenXR or WebXR, metres; raise ValueError where it is none."""
    (x, y, z), (a, b, c, d) = position, xyzw
    return checked((-1e3 * x, 1e3 * y, -1e3 * z), (d, -a, b, -c))


def from_unity(position: Sequence[float], xyzw: Sequence[float]) -> HeadPose:
    """A pose of Unity or VMC, metres; raise ValueError where it is none."""
    (x, y, z), (a, b, c, d) = position, xyzw
    return checked((-1e3 * x, 1e3 * y, 1e3 * z), (d, a, -b, -c))


def to_unity(pose: HeadPose) -> tuple[Vector, Quat]:
    """Metres and a quaternion xyzw in Unity's axes."""
    (x, y, z), (w, a, b, c) = pose.position, pose.quat
    return (-x / 1e3, y / 1e3, z / 1e3), (a, -b, -c, w)
