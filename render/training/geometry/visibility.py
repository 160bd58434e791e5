"""Which Gaussians can be seen at all: the others (tooth roots, skin under hair) cost time only."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from render.cameras import portrait
from render.types import Camera, Gaussians

PICTURE_PX = 320
DEPTH_MARGIN_MM = 5.0  # this far behind the front surface still counts as seen
YAWS_DEG, PITCHES_DEG = range(-180, 180, 30), (-25.0, 5.0, 35.0)


def views() -> Iterator[Camera]:
    """Cameras all around the head."""
    for yaw in YAWS_DEG:
        for pitch in PITCHES_DEG:
            yield portrait(PICTURE_PX, PICTURE_PX, yaw_deg=yaw, pitch_deg=pitch)


def seen(cloud: Gaussians, cameras: list[Camera]) -> NDArray[np.bool_]:  # [N]
    """True where a Gaussian lies on or just behind the front surface of one of the views."""
    visible = np.zeros(len(cloud), bool)
    for camera in cameras:
        view = camera.viewmat
        points = cloud.means @ view[:3, :3].T + view[:3, 3]
        depth = points[:, 2]
        pixel = (points[:, :2] / depth[:, None] * camera.K[0, 0] + camera.K[:2, 2]).astype(int)
        radius = 0.8 * cloud.scales[:, :2].min(1) * camera.K[0, 0] / depth
        solid = cloud.opacities > 0.5
        nearest = np.full((PICTURE_PX, PICTURE_PX), np.inf)
        reach = int(radius.max()) + 1
        for dy in range(-reach, reach + 1):
            for dx in range(-reach, reach + 1):
                covers = solid & (dx * dx + dy * dy <= radius * radius)
                x, y = pixel[covers, 0] + dx, pixel[covers, 1] + dy
                inside = (x >= 0) & (x < PICTURE_PX) & (y >= 0) & (y < PICTURE_PX)
                np.minimum.at(nearest, (y[inside], x[inside]), depth[covers][inside])
        x, y = pixel.T
        inside = (x >= 0) & (x < PICTURE_PX) & (y >= 0) & (y < PICTURE_PX)
        visible[inside] |= depth[inside] < nearest[y[inside], x[inside]] + DEPTH_MARGIN_MM
    return visible
