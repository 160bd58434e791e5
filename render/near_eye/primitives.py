"""What every near-eye picture is drawn with: the camera's matrix, the skin's grain, the eyeball."""

import numpy as np
from numpy.typing import NDArray

from render.cameras import look_at
from render.near_eye.look import Look
from render.types import Floats

GRAIN_PX = 512  # of the noise texture, for 40 mm of skin


def camera(look: Look) -> tuple[Floats, Floats]:
    """Eye space -> clip space [4, 4], and where the camera is [3]."""
    outward, below = np.radians(look.outward_deg), np.radians(look.below_deg)
    direction = np.array(
        [np.sin(outward) * np.cos(below), -np.sin(below), np.cos(outward) * np.cos(below)]
    )
    target = np.array(look.target, np.float64)
    eye = target + look.distance * direction
    view = look_at(eye, target)
    roll = np.radians(look.roll_deg)
    turn = np.eye(4)
    turn[:2, :2] = [[np.cos(roll), -np.sin(roll)], [np.sin(roll), np.cos(roll)]]
    focal = 1 / np.tan(np.radians(look.view_deg) / 2)
    near, far = 6.0, 200.0
    lens = np.zeros((4, 4))
    lens[0, 0] = focal
    lens[1, 1] = -focal  # the camera's y points down
    lens[2, 2], lens[2, 3] = (far + near) / (far - near), -2 * far * near / (far - near)
    lens[3, 2] = 1
    return (lens @ turn @ view).astype(np.float32), eye.astype(np.float32)


def place_in_picture(look: Look, point: Floats) -> tuple[float, float]:
    """A point [3] of eye space, mm -> x from the left and y from the top of the picture, 0..1."""
    x, y, _, depth = camera(look)[0] @ np.append(point, 1).astype(np.float32)
    return 0.5 + 0.5 * float(x / depth), 0.5 - 0.5 * float(y / depth)


def grain_texture() -> NDArray[np.uint8]:  # [512, 512, 4]
    """Seamless noise of four grains, each spread over 0..255."""
    rng = np.random.default_rng(0)
    frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(GRAIN_PX), np.fft.fftfreq(GRAIN_PX)))
    layers = []
    for low, high in ((0.004, 0.02), (0.02, 0.09), (0.06, 0.2), (0.03, 0.25)):
        band = np.exp(-((frequency / high) ** 2)) - np.exp(-((frequency / low) ** 2))
        wave = np.fft.ifft2(np.fft.fft2(rng.standard_normal((GRAIN_PX, GRAIN_PX))) * band).real
        layers.append(np.clip(0.5 + wave / wave.std() * 0.18, 0, 1))
    return (255 * np.stack(layers, -1)).astype(np.uint8)


def sphere(radius_mm: float, rows: int = 14, columns: int = 28) -> tuple[Floats, NDArray[np.int32]]:
    """The eyeball's front: [n, 9] place, normal, rest; and triangles."""
    polar = np.linspace(0, 0.62 * np.pi, rows)[:, None]
    around = np.linspace(0, 2 * np.pi, columns, endpoint=False)[None]
    unit = np.stack(
        [
            np.sin(polar) * np.cos(around),
            np.sin(polar) * np.sin(around),
            np.cos(polar) + 0 * around,
        ],
        -1,
    ).reshape(-1, 3)
    first = np.arange((rows - 1) * columns).reshape(rows - 1, columns)
    right = first - first % columns + (first + 1) % columns
    quads = (first, right, first + columns, first + columns, right, right + columns)
    faces = np.stack(quads, -1).reshape(-1, 3).astype(np.int32)
    return np.concatenate([radius_mm * unit, unit, unit], 1).astype(np.float32), faces
