"""What melanin and age make of a skin's colour: gains of linear light, by the place on the face."""

import numpy as np

from render.training.look.places import Places, soft
from render.training.look.relief import Relief, noise
from render.types import Floats

MELANIN = np.array([0.85, 1.0, 1.0], np.float32)  # of red, green, blue, what it takes away
LINE_MM = -34.0  # between the lips
UPPER_LIP, LOWER_LIP = (0.86, 0.84, 0.83), (1.14, 1.08, 1.12)  # of a dark skin, both of its hue
CLEAR_MM = 4.0  # of the edge of a lip to its middle
SPOT = np.array([0.55, 0.85, 1.0], np.float32)  # colour of age spots
GREY = 0.16  # of an old skin, between its colour and grey
VEINS = np.array([0.10, -0.10, -0.06], np.float32)
HOLLOW = np.array([0.11, 0.17, 0.14], np.float32)  # below old eyes
PALE = np.array([0.98, 1.12, 1.10], np.float32)  # old lips
# Lines of an old face at rest: x, y in mm along each, how deep, how wide in mm.
LINES = (
    (((25, -38), (28, -46), (29, -55), (28, -62)), 0.16, 1.7),  # from the corners of the mouth down
    (((17, 24), (24, 18.5), (33, 17), (42, 20)), 0.11, 1.6),  # below the bags
    (((38, -22), (42, -34), (42, -46)), 0.06, 2.0),  # of the cheek
    (((0, -52), (10, -53), (19, -57)), 0.10, 2.0),  # between lip and chin
    (((6, -16), (6.5, -24)), 0.05, 1.2),
    (((12, -18), (13, -26)), 0.06, 1.2),  # over the upper lip
    (((18, -22), (19, -29)), 0.06, 1.2),
)


def deep(skin: Floats, melanin: float, places: Places, relief: Relief) -> Floats:
    """[SIZE, SIZE, 3] -> the same, dark where deep skin is darker: around the eyes, on the temples
    and around the mouth; the lips of two colours. `melanin`: 0 even .. 1."""
    spot = places.spot
    lips = soft(places.lips, 1.5)
    dark = 0.16 * spot(32, 32, 19, 12) + 0.14 * spot(62, 52, 20, 32) + 0.16 * spot(0, -36, 34, 15)
    dark += 0.10 * spot(0, 92, 60, 16) + 0.10 * spot(0, -84, 60, 14)
    dark -= 0.24 * spot(38, 4, 19, 16) + 0.12 * spot(0, 18, 9, 20) + 0.14 * spot(0, 66, 26, 14)
    dark -= 0.10 * spot(0, -62, 14, 9)
    dark = (dark + 0.025 * relief.clouds + 0.01 * relief.patches) * (1 - lips)
    out = skin * np.clip(1 - melanin * dark[..., None] * MELANIN, 0.4, 1.5)
    inner = np.clip(1 - np.abs(places.up - LINE_MM) / CLEAR_MM, 0, 1)
    upper = np.clip(0.5 + (places.up - LINE_MM), 0, 1)[..., None]
    color = upper * np.array(UPPER_LIP) + (1 - upper) * np.array(LOWER_LIP)
    color = color * (1 + 0.06 * inner[..., None] * np.array([1.3, 0.7, 0.8]))
    return (out * (1 + melanin * lips[..., None] * (color - 1))).astype(np.float32)


def old(skin: Floats, age: float, places: Places, relief: Relief) -> Floats:
    """[SIZE, SIZE, 3] -> the same so old: spots, veins, shadows below the eyes, duller, lines."""
    lips, points = soft(places.lips, 1.5), places.points
    bare = np.clip(1 - 1.2 * soft(np.clip(places.lids + places.lips, 0, 1), 2.5), 0, 1)
    grey = skin.mean(-1, keepdims=True)
    out = skin + GREY * age * (grey * np.array([1.06, 1.0, 0.94], np.float32) - skin)
    where = places.spot(60, 42, 22, 34) + 0.6 * places.cheeks + 0.7 * places.forehead
    spots = np.clip(3 * (noise(points, 9, 51, 2) - 1.35), 0, 1) * np.clip(where, 0, 1)
    spots += 0.6 * np.clip(3 * (noise(points, 4.5, 52, 1) - 1.5), 0, 1) * np.clip(where, 0, 1)
    blotches = 0.05 * relief.clouds + 0.04 * noise(points, 13, 53, 2)
    out = out * (1 - age * (0.30 * soft(spots, 1.2) * bare + blotches * bare)[..., None] * SPOT)
    veins = np.clip(1 - 6 * np.abs(noise(points, 8, 54, 2)), 0, 1)
    veins *= np.clip(places.cheeks + places.nose, 0, 1)
    out = out * (1 + age * soft(veins, 0.7)[..., None] * VEINS)
    hollow = places.spot(28, 20, 16, 6) + 0.5 * places.spot(22, 30, 8, 10)
    out = out * (1 - age * hollow[..., None] * HOLLOW)
    out = out * (1 + age * lips[..., None] * (PALE - 1))
    return (out * (1 - age * _lines(places)[..., None])).astype(np.float32)


def _lines(places: Places) -> Floats:  # [SIZE, SIZE]
    """How much darker; below zero: lit."""
    front = (places.face > 0.5) & (places.points[..., 2] > 60)
    out = np.zeros_like(places.up)
    for course, depth, width in LINES:
        off, along = _off(np.stack([places.across, places.up], -1), np.array(course, np.float32))
        end = np.clip(5 * along * (1 - along), 0, 1)
        if course[0][0] == 0:
            end = np.clip(5 * (1 - along), 0, 1)
        lit = np.exp(-(((off - 2.2 * width) / (1.4 * width)) ** 2))
        out += depth * end * (np.exp(-((off / width) ** 2)) - 0.4 * lit)
    return out * soft(front.astype(np.float32), 4)


def _off(points: Floats, course: Floats) -> tuple[Floats, Floats]:  # [..., 2], [k, 2]
    """The distance from a line, right of its course above zero; how far along, 0..1."""
    best, side = np.full(points.shape[:2], np.inf, np.float32), np.zeros(points.shape[:2])
    along, pieces = np.zeros(points.shape[:2], np.float32), len(course) - 1
    for k, (start, end) in enumerate(zip(course, course[1:], strict=False)):
        way, from_start = end - start, points - start
        share = np.clip(from_start @ way / (way @ way), 0, 1)
        away = from_start - share[..., None] * way
        far = np.hypot(away[..., 0], away[..., 1])
        near = far < best
        best, along = np.where(near, far, best), np.where(near, (k + share) / pieces, along)
        turn = way[1] * from_start[..., 0] - way[0] * from_start[..., 1]
        side = np.where(near, np.sign(turn), side)
    return (best * side).astype(np.float32), along.astype(np.float32)
