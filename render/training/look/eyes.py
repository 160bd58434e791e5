"""Pictures of eyes: the pupil in the middle, the distance from it the angle (face_data.py)."""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates

from render.lighting import LUMINANCE
from render.training.data.face_data import EYE_PICTURE_DEG, FaceData
from render.types import Floats

Array = NDArray[np.floating]
SIZE = 512
IRIS_DEG, PUPIL = 21.6, 0.30  # half angle; share of its radius
# Linear colour of the iris, and near the pupil.
COLORS = {
    "blue": ((0.17, 0.235, 0.31), (0.27, 0.25, 0.19)),
    "brown": ((0.115, 0.055, 0.024), (0.15, 0.064, 0.025)),
    "brownlight": ((0.20, 0.115, 0.045), (0.17, 0.075, 0.025)),
    "green": ((0.16, 0.20, 0.095), (0.30, 0.22, 0.10)),
    "grey": ((0.21, 0.24, 0.245), (0.27, 0.235, 0.175)),
}
WHITE, RED = (0.47, 0.425, 0.385), (0.14, 0.29, 0.31)  # of the eyeball; less of it at the rim
LIMBUS = 0.80  # how much darker the outermost ring of an iris is
MIDDLE = 0.28  # brightness of Reom's iris
COLLAR = 0.235  # where its pupil ends
RINGS = 40  # of an iris, each of which is lit evenly


def picture(face: FaceData, name: str) -> Floats:  # [SIZE, SIZE, 3] stored, 0..1
    """One colour of eyes."""
    x, y, away = _places()
    radius, around = away / IRIS_DEG, np.arctan2(y, x)
    inner = np.clip((radius - PUPIL) / (1 - PUPIL), 0, 1)
    fibres = _fibres(face, COLLAR + (1 - COLLAR) * inner, around)
    outside, inside = (np.array(c, np.float32) for c in COLORS[name])
    collar = 0.75 * np.clip(1 - inner / 0.45, 0, 1)[..., None]
    iris = (outside * (1 - collar) + inside * collar) * fibres[..., None]
    iris = iris * (1 - LIMBUS * np.clip((radius - 0.70) / 0.26, 0, 1) ** 1.5)[..., None]
    pupil = np.clip((radius - PUPIL) / 0.035, 0, 1)[..., None]
    iris = iris * pupil + (1 - pupil) * 0.004
    rim = np.clip((away - 30) / 45, 0, 1)[..., None]
    white = np.array(WHITE) * (1 - rim * np.array(RED)) * _veins(x, y, away)
    edge = np.clip((1.08 - radius) / 0.17, 0, 1)
    edge = (edge * edge * (3 - 2 * edge))[..., None]
    return np.sqrt(np.clip(iris * edge + white * (1 - edge), 0, 1)).astype(np.float32)


def toned(picture: Floats, whites: tuple[float, float, float], irises: float) -> Floats:
    """A picture of an eye with other whites and irises: gains of their linear colour."""
    share = np.clip((_places()[2] / IRIS_DEG - 0.94) / 0.10, 0, 1)[..., None]
    gain = np.sqrt(irises) + share * (np.sqrt(np.array(whites)) - np.sqrt(irises))
    return (picture * gain).astype(np.float32)


def _places() -> tuple[Array, Array, Array]:
    """[SIZE, SIZE] each: x, y up, and degrees from the pupil."""
    at = (np.arange(SIZE) + 0.5) / SIZE - 0.5
    x, y = np.meshgrid(at, -at)
    return x, y, np.hypot(x, y) / 0.499 * EYE_PICTURE_DEG


def _fibres(face: FaceData, radius: Array, around: Array) -> Floats:  # [...] gain, about 1
    """Of Reom's iris (CC BY), or drawn if that picture is not there."""
    path = face.folder / "reom" / "Iris_BaseColor_Edit.jpg"
    if path.is_file():
        light = face.image(f"reom/{path.name}") @ LUMINANCE
        light = gaussian_filter(light, light.shape[0] / 2048)
        half = 0.5 * light.shape[0]
        where = [half - 0.99 * half * radius * np.sin(around),
                 half + 0.99 * half * radius * np.cos(around)]  # fmt: skip
        gain = map_coordinates(light, where, order=1, mode="nearest") / MIDDLE
    else:
        rays = np.random.default_rng(5).standard_normal(240)
        gain = 1 + 0.25 * np.interp(around % (2 * np.pi), np.linspace(0, 2 * np.pi, 240), rays)
    return np.clip(_evenly_lit(gain, radius, around), 0.25, 2.4).astype(np.float32) ** 1.05


def _evenly_lit(gain: Array, radius: Array, around: Array) -> Array:  # [...] each
    """Without the light of the photograph, which came from one side: it would draw the dark rim of
    the iris to the other, and a look with it. Fibres end in that rim."""
    out, ring = gain.copy(), np.rint(radius * RINGS)
    waves = np.stack([f(k * around) for k in (1, 2) for f in (np.cos, np.sin)], -1)
    for of in np.unique(ring):
        rows = ring == of
        system = np.concatenate([np.ones((int(rows.sum()), 1)), waves[rows]], 1)
        fit = np.linalg.lstsq(system, gain[rows], rcond=None)[0]
        out[rows] *= fit[0] / np.maximum(system @ fit, 0.25 * fit[0])
        out[rows] += np.clip((of / RINGS - 0.7) / 0.2, 0, 1) * (fit[0] - out[rows])
    return out


def _veins(x: Array, y: Array, away: Array) -> Floats:  # [..., 3] gain
    """Fine red lines away from the iris."""
    rng = np.random.default_rng(9)
    field = gaussian_filter(rng.standard_normal((SIZE, SIZE)), 5)
    lines = np.clip(1 - np.abs(field / field.std()) / 0.10, 0, 1)
    share = lines * np.clip((away - 30) / 20, 0, 1) * 0.13
    share += 0.05 * gaussian_filter(rng.standard_normal((SIZE, SIZE)), 12) * 12
    return 1 - share[..., None] * np.array([0.15, 1.0, 1.0])
