"""The headset's two eye cameras, simulated: infrared pictures of the eyes from a few centimetres.

Draws the decoder's Gaussians from a camera below each eye. First version: the red channel stands
for infrared, with the sensor's vignette and noise; no glints, no lens distortion.
"""

import numpy as np
from numpy.typing import NDArray

from render.cameras import look_at
from render.types import Camera, Gaussians, Renderer

SIZE_PX = 400
DISTANCE_MM = 62.0
BELOW_DEG, OUTWARD_DEG = 22.0, 12.0  # the camera sits at the lower outer rim of the lens
FIELD_OF_VIEW_DEG = 46.0
NOISE = 2.0  # standard deviation in grey levels


def eye_camera(eye_center: NDArray[np.float32], eye: int) -> Camera:
    """Camera of one eye (0 = left) around its centre [3] mm."""
    outward = np.radians(OUTWARD_DEG) * (1 if eye == 0 else -1)
    below = np.radians(BELOW_DEG)
    direction = np.array(
        [np.sin(outward) * np.cos(below), -np.sin(below), np.cos(outward) * np.cos(below)]
    )
    target = eye_center.astype(np.float64) + [0, 0, 12.0]
    focal_px = SIZE_PX / 2 / np.tan(np.radians(FIELD_OF_VIEW_DEG / 2))
    return Camera(
        viewmat=look_at(target + DISTANCE_MM * direction, target),
        K=np.array([[focal_px, 0, SIZE_PX / 2], [0, focal_px, SIZE_PX / 2], [0, 0, 1]]),
        width=SIZE_PX,
        height=SIZE_PX,
        near_mm=8.0,
        background=(0.02, 0.02, 0.02),
    )


def draw_eyes(
    gaussians: Gaussians,
    eye_centers: NDArray[np.float32],  # [2, 3] mm
    renderer: Renderer,
    rng: np.random.Generator,
) -> NDArray[np.uint8]:  # [2, 400, 400]
    """Both cameras' pictures of one moment."""
    ramp = np.linspace(-1, 1, SIZE_PX)
    vignette = 1 - 0.35 * np.clip(np.hypot(*np.meshgrid(ramp, ramp)), 0, 1.3) ** 2
    out = np.empty((2, SIZE_PX, SIZE_PX), np.uint8)
    for eye in range(2):
        renderer.draw(gaussians, eye_camera(eye_centers[eye], eye))
        infrared = renderer.read_rgba()[..., 0] * vignette
        infrared += NOISE * rng.standard_normal(infrared.shape)
        out[eye] = infrared.clip(0, 255)
    return out
