"""Cameras that look at the head. World: +x subject's left, +y up, +z forward, millimetres."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from render.types import DEFAULT_BACKGROUND, Camera
from sensors.types import InputError

HEAD_CENTRE_MM = (0.0, 15.0, 0.0)  # between the chin (~ -110) and the top of the head (~ +140)
PORTRAIT_SPAN_MM = 320.0  # what the shorter side of the picture shows at the target
PORTRAIT_DISTANCE_MM = 900.0
MAX_PITCH_DEG = 85.0
ZOOM_RANGE = (0.4, 8.0)
MOVE_RANGE_MM = 200.0


def look_at(
    position_mm: NDArray[np.float64], target_mm: NDArray[np.float64]
) -> NDArray[np.float64]:
    """World-to-camera matrix [4, 4] of a level camera."""
    forward = target_mm - position_mm
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, (0.0, 1.0, 0.0))
    right = right / np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])  # rows: x right, y down, z in
    viewmat = np.eye(4)
    viewmat[:3, :3] = rotation
    viewmat[:3, 3] = -rotation @ position_mm
    return viewmat


def portrait(
    width: int,
    height: int,
    yaw_deg: float = 0.0,
    pitch_deg: float = 0.0,
    distance_mm: float = PORTRAIT_DISTANCE_MM,
    target_mm: tuple[float, float, float] = HEAD_CENTRE_MM,
    background: tuple[float, float, float] = DEFAULT_BACKGROUND,
) -> Camera:
    """Head-and-neck portrait. The camera circles the target: yaw > 0 towards the subject's left,
    pitch > 0 upwards; the lens is chosen so that the head has the same size at any distance."""
    if width < 1 or height < 1:
        raise InputError(f"picture size: expected at least 1x1, got {width}x{height}; set --size")
    if abs(pitch_deg) > 89.0:
        raise InputError(f"pitch: expected -89..89 degrees, got {pitch_deg:g}; set a smaller pitch")
    if distance_mm <= 0.0:
        raise InputError(f"camera distance: expected > 0 mm, got {distance_mm:g}; move it away")
    yaw, pitch = np.radians(yaw_deg), np.radians(pitch_deg)
    direction = np.array([np.sin(yaw) * np.cos(pitch), np.sin(pitch), np.cos(yaw) * np.cos(pitch)])
    target = np.asarray(target_mm, np.float64)
    focal_px = min(width, height) * distance_mm / PORTRAIT_SPAN_MM
    K = np.array([[focal_px, 0.0, width / 2], [0.0, focal_px, height / 2], [0.0, 0.0, 1.0]])
    return Camera(
        viewmat=look_at(target + distance_mm * direction, target),
        K=K,
        width=width,
        height=height,
        near_mm=10.0,
        background=background,
    )


@dataclass(frozen=True)
class Orbit:
    """A camera that the user turns around the head; every move returns a new value."""

    yaw_deg: float = 0.0  # towards the subject's left
    pitch_deg: float = 0.0  # upwards
    zoom: float = 1.0  # 2: everything is twice as large
    right_mm: float = 0.0  # how far the head is moved in the picture
    up_mm: float = 0.0

    def turned(self, yaw_deg: float, pitch_deg: float) -> "Orbit":
        yaw = (self.yaw_deg + yaw_deg + 180.0) % 360.0 - 180.0
        pitch = min(max(self.pitch_deg + pitch_deg, -MAX_PITCH_DEG), MAX_PITCH_DEG)
        return replace(self, yaw_deg=yaw, pitch_deg=pitch)

    def zoomed(self, factor: float) -> "Orbit":
        return replace(self, zoom=min(max(self.zoom * factor, ZOOM_RANGE[0]), ZOOM_RANGE[1]))

    def moved(self, right_mm: float, up_mm: float) -> "Orbit":
        right, up = (
            min(max(value, -MOVE_RANGE_MM), MOVE_RANGE_MM)
            for value in (self.right_mm + right_mm, self.up_mm + up_mm)
        )
        return replace(self, right_mm=right, up_mm=up)

    def mm_per_px(self, width: int, height: int) -> float:
        """Size of a pixel at the head's centre."""
        return PORTRAIT_SPAN_MM / (self.zoom * min(width, height))

    def camera(
        self,
        width: int,
        height: int,
        background: tuple[float, float, float] = DEFAULT_BACKGROUND,
    ) -> Camera:
        """The camera of this moment."""
        base = portrait(width, height, self.yaw_deg, self.pitch_deg, background=background)
        K = base.K.copy()
        K[0, 0] *= self.zoom
        K[1, 1] *= self.zoom
        mm_per_px = self.mm_per_px(width, height)
        K[0, 2] += self.right_mm / mm_per_px
        K[1, 2] -= self.up_mm / mm_per_px
        return replace(base, K=K)
