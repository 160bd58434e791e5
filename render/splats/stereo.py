"""Two eyes: side by side on a flat 3D screen, or through the two lenses of a headset.

A viewer's head has the avatar's axes: +x to its left, +y up, +z forward. Each eye is drawn by
itself, on a GPU from one upload. Eyes with parallel axes see equal depths, so one sort would serve
both exactly, but that of 30,000 Gaussians (0.3 ms) is 2 % of what a pair costs on two cores.
"""

import numpy as np
from numpy.typing import NDArray

from render.types import DEFAULT_BACKGROUND, Camera, Gaussians, Renderer
from sensors.types import InputError

EYE_DISTANCE_MM = 63.9  # of the avatars, and near the adult mean
CAMERA_FROM_HEAD = np.diag([-1.0, -1.0, 1.0, 1.0])  # a camera's x is right, its y down
Tangents = tuple[float, float, float, float]  # of a view's edges: left, right, up, down


def eye_viewmats(
    head: NDArray[np.float64],  # [4, 4] the viewer's head to world, mm
    eye_distance_mm: float = EYE_DISTANCE_MM,
) -> NDArray[np.float64]:  # [2, 4, 4] world to camera, left eye first
    """View matrices of both eyes of a head that looks along its +z."""
    if eye_distance_mm < 0.0:
        raise InputError(f"eye distance: expected 0 mm or more, got {eye_distance_mm:g}; try 63.9")
    views = np.empty((2, 4, 4))
    for eye, side in enumerate((0.5, -0.5)):
        pose = head.copy()
        pose[:3, 3] += side * eye_distance_mm * head[:3, 0]
        views[eye] = CAMERA_FROM_HEAD @ np.linalg.inv(pose)
    return views


def off_axis(
    viewmat: NDArray[np.float64],  # [4, 4] world to camera
    tangents: Tangents,
    width: int,
    height: int,
    near_mm: float = 10.0,
    background: tuple[float, float, float] = DEFAULT_BACKGROUND,
) -> Camera:
    """The camera of one eye of a headset, whose view is wider to one side than to the other.

    `tangents` are positive for an edge on its own side: OpenXR's tan(-angleLeft), tan(angleRight),
    tan(angleUp), tan(-angleDown).
    """
    left, right, up, down = tangents
    if left + right <= 0.0 or up + down <= 0.0:
        raise InputError(
            f"field of view: expected left + right > 0 and up + down > 0, got {tangents}; "
            "give the tangents of the angles between the axis and each edge"
        )
    fx, fy = width / (left + right), height / (up + down)
    K = np.array([[fx, 0.0, fx * left], [0.0, fy, fy * up], [0.0, 0.0, 1.0]])
    return Camera(viewmat, K, width, height, near_mm, background)


def side_by_side(
    camera: Camera, eye_distance_mm: float = EYE_DISTANCE_MM, screen_mm: float | None = None
) -> tuple[Camera, Camera]:
    """Left and right camera of a viewer at `camera` before a flat 3D screen.

    What is `screen_mm` away lies in the screen; nearer things come out of it. None: the distance
    to the world's origin, which is in the head. The axes stay parallel, the pictures are shifted.
    """
    distance = float(camera.viewmat[2, 3]) if screen_mm is None else screen_mm
    if distance <= 0.0:
        raise InputError(f"screen: expected a distance > 0 mm, got {distance:g}; give screen_mm")
    pair: list[Camera] = []
    for side in (0.5, -0.5):  # an eye to the left sees everything further to the right
        viewmat, K = camera.viewmat.copy(), camera.K.copy()
        viewmat[0, 3] += side * eye_distance_mm
        K[0, 2] -= side * eye_distance_mm * K[0, 0] / distance
        near, behind = camera.near_mm, camera.background
        pair.append(Camera(viewmat, K, camera.width, camera.height, near, behind))
    return pair[0], pair[1]


def draw_pair(
    renderer: Renderer, gaussians: Gaussians, cameras: tuple[Camera, Camera]
) -> NDArray[np.uint8]:  # [H, 2 * W, 4]
    """Both pictures beside each other, the left eye's on the left."""
    left, right = cameras
    if left.height != right.height:
        raise InputError(
            f"stereo: expected two pictures of one height, got {left.height} and {right.height}; "
            "use one height for both cameras"
        )
    pair = np.empty((left.height, left.width + right.width, 4), np.uint8)
    renderer.draw(gaussians, left)
    pair[:, : left.width] = renderer.read_rgba()
    renderer.draw(gaussians, right)
    pair[:, left.width :] = renderer.read_rgba()
    return pair
