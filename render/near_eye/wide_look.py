"""Headsets of all kinds: cameras at the temple, below, or behind the lens; lamps anywhere; wearers
whose skin, iris, lashes and lids differ more than `Look.draw` lets them.

What no renderer of ours draws (glasses, make-up, wrinkles, hairs, compression) is painted over the
finished picture. For training what has to see real cameras; drawn anew for each person.
"""

import io
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from render.near_eye.look import MAX_LEDS, Look

# What the middle of a well framed picture shows, and the pupil: mm from the eyeball's centre.
AIM = (0.5, 0.5, 13.0)
PUPIL_MM = 13.2
Grey = NDArray[np.uint8]


def wide_look(look: Look, rng: np.random.Generator) -> Look:
    """The same person in another headset, seen with more room around the eye."""
    u = rng.uniform
    kind = rng.random()
    if kind < 0.3:  # from the temple
        outward, below = u(15, 58), u(-12, 25)
    elif kind < 0.75:  # from below
        outward, below = u(-22, 28), u(5, 52)
    else:  # through the lens
        outward, below = u(-15, 15), u(-14, 10)
    distance, span = _even(rng, 26, 110), u(58, 78)
    right, up = np.radians([outward, below])
    direction = np.array([np.sin(right) * np.cos(up), -np.sin(up), np.cos(right) * np.cos(up)])
    return replace(
        look,
        outward_deg=outward, below_deg=below, distance=distance,
        target=(AIM[0] + u(-2, 2), AIM[1] + u(-2, 2), AIM[2]),
        view_deg=float(np.degrees(2 * np.arctan(span / 2 / distance))), roll_deg=u(-6, 6),
        leds=_lamps(np.array(AIM) + distance * direction, rng),
        pupil=u(1.3, 5.0), iris=u(6.4, 8.0), sclera_tone=u(0.28, 1.2),
        iris_tone=_even(rng, 0.09, 0.75),
        pupil_tone=u(0.2, 0.8) if rng.random() < 0.04 else _even(rng, 0.004, 0.07),
        limbus=u(0.15, 1.1), fibres=u(0.05, 0.8),
        albedo=u(0.25, 0.95), gloss=u(0, 0.6) if rng.random() < 0.8 else u(0.6, 1.3),
        pores=u(0.1, 1.4),
        lash_length=u(3.5, 11.5), lash_curl=u(0.05, 1.0), lashes=int(rng.integers(15, 150)),
        lash_shade=_even(rng, 0.01, 0.35), lash_width=u(0.08, 0.3),
        brow_hairs=int(rng.integers(0, 700)),
        gamma=u(0.5, 1.15), exposure=_even(rng, 25, 170), blur_px=u(0.3, 2.6), noise=u(0.3, 6),
        vignette=u(0, 0.9), reflections=int(rng.integers(1, 4)) if rng.random() < 0.15 else 0,
        backdrop=u(0, 0.15),
    )  # fmt: skip


def _even(rng: np.random.Generator, low: float, high: float) -> float:
    """Any order of magnitude is as likely as any other."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _lamps(
    camera: NDArray[np.float64], rng: np.random.Generator
) -> tuple[tuple[float, float, float], ...]:
    """A ring, a few beside the camera, or some anywhere in the headset."""
    u, style = rng.uniform, rng.random()
    if style < 0.35:
        count, ring, plane, first = (
            int(rng.integers(1, MAX_LEDS + 1)),
            u(8, 28),
            u(22, 50),
            u(0, 6.28),
        )
        angles = first + 2 * np.pi * np.arange(count) / count
        places = [
            (ring * np.cos(a) + u(-2, 2), ring * np.sin(a) + u(-2, 2), plane + u(-3, 3))
            for a in angles
        ]
    elif style < 0.7:
        places = [camera * u(0.6, 1) + rng.normal(0, 6, 3) for _ in range(int(rng.integers(1, 4)))]
    else:
        places = [(u(-30, 30), u(-30, 25), u(25, 60)) for _ in range(int(rng.integers(1, 5)))]
    return tuple((float(x), float(y), max(float(z), 20.0)) for x, y, z in places)


def painted(picture: Grey, person: np.random.Generator, rng: np.random.Generator) -> Grey:
    """[H, W] with what lies before or on the skin; `person` draws what stays over a clip."""
    from PIL import Image, ImageDraw, ImageFilter

    side = picture.shape[0]
    layer = Image.new("L", (side, side), 128)  # 128 changes nothing
    draw, u = ImageDraw.Draw(layer), person.uniform
    painted_any = False
    if person.random() < 0.35:  # wrinkles, hairs
        for _ in range(int(person.integers(1, 7))):
            tone, width = int(128 + u(-45, 25)), int(person.integers(1, 4))
            draw.line(_curve(person, side), fill=tone, width=width)
        painted_any = True
    if person.random() < 0.12:  # the frame of glasses
        box = _oval(side, u(0.2, 0.8), u(0.3, 0.7), u(0.4, 0.8), u(0.3, 0.6))
        draw.ellipse(box, outline=int(u(10, 90)), width=int(person.integers(4, 16)))
        painted_any = True
    if person.random() < 0.1:  # make-up, a shadow
        box = _oval(side, u(0, 1), u(0, 1), u(0.1, 0.4), u(0.1, 0.4))
        draw.ellipse(box, fill=int(128 + u(-60, 40)))
        painted_any = True
    if painted_any:
        layer = layer.filter(ImageFilter.GaussianBlur(float(u(0.5, 2.5))))
        share = np.asarray(layer, np.float32) / 128
        picture = np.clip(picture.astype(np.float32) * share, 0, 255).astype(np.uint8)
    if rng.random() < 0.25:  # compression
        packed = io.BytesIO()
        Image.fromarray(picture).save(packed, "JPEG", quality=int(rng.uniform(12, 85)))
        picture = np.asarray(Image.open(packed))
    return picture


def _curve(rng: np.random.Generator, side: int) -> list[tuple[float, float]]:
    ends = rng.uniform(-0.1, 1.1, (3, 2)) * side
    t = np.linspace(0, 1, 14)[:, None]
    path = (1 - t) ** 2 * ends[0] + 2 * t * (1 - t) * ends[1] + t**2 * ends[2]
    return [(float(x), float(y)) for x, y in path]


def _oval(side: int, x: float, y: float, across: float, down: float) -> tuple[float, ...]:
    return tuple(side * v for v in (x - across, y - down, x + across, y + down))
