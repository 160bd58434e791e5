"""Where the head stands, and what each eye sees of it.

LOCAL space and the avatar's world have the same axes while the wearer looks along -z: a head that
faces them has its left on their right. So the avatar only needs to be moved, and turned about the
vertical.
"""

import numpy as np

from app.xr.runtimes.protocol import XYZW, Eye
from render.splats.stereo import off_axis
from render.types import Camera, Doubles
from sensors.rotation import Vector

AHEAD_MM = 700.0  # from the wearer's eyes to those of the head
NEAR_MM = 50.0
CAMERA_FROM_EYE = np.diag([1.0, -1.0, -1.0, 1.0])  # a camera's y is down, its z into the scene
Colour = tuple[float, float, float]


def pose_matrix(position: Vector, xyzw: XYZW) -> Doubles:  # [4, 4] to LOCAL, mm
    x, y, z, w = np.asarray(xyzw) / np.linalg.norm(xyzw)
    pose = np.eye(4)
    pose[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    pose[:3, 3] = 1e3 * np.asarray(position)
    return pose


def in_front(
    eyes: tuple[Eye, Eye],
    between_eyes: Doubles,  # [3] mm, of the avatar
) -> Doubles:  # [4, 4] avatar to LOCAL, mm
    """Upright, facing the wearer, eye to eye."""
    left, right = (pose_matrix(eye.position, eye.xyzw) for eye in eyes)
    back = left[:3, 2] + right[:3, 2]  # of both heads: the wearer looks the other way
    yaw = np.arctan2(back[0], back[2])
    place = np.eye(4)
    place[[0, 0, 2, 2], [0, 2, 0, 2]] = np.cos(yaw), np.sin(yaw), -np.sin(yaw), np.cos(yaw)
    ahead = (left[:3, 3] + right[:3, 3]) / 2 - AHEAD_MM * place[:3, 2]
    place[:3, 3] = ahead - place[:3, :3] @ between_eyes
    return place


def eye_camera(
    eye: Eye,
    place: Doubles,  # [4, 4] avatar to LOCAL, mm
    width: int,  # px
    height: int,
    background: Colour,
) -> Camera:
    """The camera of one eye, in the avatar's world."""
    viewmat = CAMERA_FROM_EYE @ np.linalg.inv(pose_matrix(eye.position, eye.xyzw)) @ place
    return off_axis(viewmat, eye.tangents, width, height, NEAR_MM, background)
