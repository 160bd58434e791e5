"""Pictures in which there is no eye: what a headset on a table sees, so that it is told from one.

Rooms of flat shapes, cloth and foam, lens rims with the mirror images of their lamps, cables, light
falling in; sharp or far out of focus, bright or nearly black. Nothing in them was photographed.
"""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from PIL.ImageDraw import ImageDraw as Draw

Floats = NDArray[np.float32]


def no_eye(rng: np.random.Generator, side: int) -> NDArray[np.uint8]:  # [side, side]
    from PIL import Image, ImageDraw, ImageFilter

    u = rng.uniform
    ramp = np.linspace(-1, 1, side)
    light = u(5, 170) + grain(rng, side, u(0.4, 2.2)) * u(1, 45)
    if rng.random() < 0.5:
        light = light + u(-60, 60) * ramp + u(-60, 60) * ramp[:, None]
    image = Image.fromarray(np.clip(light, 0, 255).astype(np.uint8))
    if rng.random() < 0.8:
        draw = ImageDraw.Draw(image)
        for _ in range(int(rng.integers(0, 14))):
            _shape(draw, rng, side)
    if rng.random() < 0.7:
        log_px = u(float(np.log(0.4)), float(np.log(9)))
        image = image.filter(ImageFilter.GaussianBlur(float(np.exp(log_px))))
    light = np.asarray(image, np.float32)
    if rng.random() < 0.35:  # cloth, foam
        light = light + grain(rng, side, u(0.2, 1.2)) * u(2, 25)
    if rng.random() < 0.5:
        light = _lamps(light.astype(np.float32), rng)
    away = np.hypot(ramp - u(-0.2, 0.2), (ramp - u(-0.2, 0.2))[:, None])
    if rng.random() < 0.2:  # light that falls in
        light = light + u(60, 255) * np.exp(-((away / u(0.1, 0.5)) ** 2))
    if rng.random() < 0.4:
        light = light * (1 - u(0.2, 0.95) * np.clip(away / 1.2, 0, 1) ** 2)
    if rng.random() < 0.3:  # the rim of a lens
        light = light * np.clip((u(0.6, 1.2) - np.hypot(ramp, ramp[:, None])) * u(3, 30), 0.05, 1)
    if rng.random() < 0.3:
        light = light * u(0.05, 0.4)
    light = light + rng.normal(0, u(0.5, 6), (side, side))
    return np.clip(light, 0, 255).astype(np.uint8)


def grain(rng: np.random.Generator, side: int, power: float) -> Floats:
    """Noise [side, side] of mean 0 and deviation 1; the larger the power, the softer."""
    frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(side), np.fft.fftfreq(side)))
    frequency[0, 0] = 1
    waves = np.fft.fft2(rng.standard_normal((side, side))) * frequency**-power
    noise = np.fft.ifft2(waves).real
    return ((noise - noise.mean()) / noise.std()).astype(np.float32)


def _shape(draw: "Draw", rng: np.random.Generator, side: int) -> None:
    u, kind = rng.uniform, rng.random()
    tone = int(np.clip(u(-20, 275), 0, 255))
    x, y = u(-0.2, 1.2, 2) * side
    if kind < 0.3:
        corners = u(-0.2, 1.2, (int(rng.integers(3, 6)), 2)) * side
        draw.polygon([tuple(corner) for corner in corners.tolist()], fill=tone)
    elif kind < 0.5:  # cables
        places = u(-0.2, 1.2, (3, 2)) * side
        draw.line([tuple(p) for p in places.tolist()], fill=tone, width=int(rng.integers(1, 12)))
    elif kind < 0.75:  # holes, buttons, rings
        across = u(0.02, 0.55) * side
        down = across * u(0.5, 1)
        box = (x - across, y - down, x + across, y + down)
        ring = rng.random() < 0.5
        width = int(rng.integers(1, 25)) if ring else 1
        draw.ellipse(box, fill=None if ring else tone, outline=tone, width=width)
    elif kind < 0.87:
        draw.rectangle((x, y, x + u(0.03, 0.6) * side, y + u(0.03, 0.6) * side), fill=tone)
    else:  # a row of bars
        for bar in range(int(rng.integers(3, 14))):
            place = x + 6 * bar
            end = (place + u(-3, 3), y + u(10, 80))
            draw.line([(place, y), end], fill=tone, width=int(rng.integers(1, 4)))


def _lamps(light: Floats, rng: np.random.Generator) -> Floats:
    """A ring of small mirror images."""
    u, side = rng.uniform, len(light)
    rows, columns = np.mgrid[0:side, 0:side].astype(np.float32)
    (x, y), ring, size = u(0.1, 0.9, 2) * side, u(0.03, 0.5) * side, u(1, 5)
    count, first, bright = int(rng.integers(1, 10)), u(0, 6.3), u(60, 250)
    for k in range(count):
        angle = first + 2 * np.pi * k / count
        across, down = x + ring * np.cos(angle), y + 0.9 * ring * np.sin(angle)
        away = ((columns - across) ** 2 + (rows - down) ** 2) / size**2
        light = light + bright * np.exp(-(np.minimum(away, 50) ** 2))
    return light
