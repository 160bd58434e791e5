"""A shirt below the neck: the bust ends in cloth, which Maker fades out, instead of in a cut."""

import numpy as np
from numpy.typing import NDArray

from render.types import Floats

FRONT_MM, BACK_MM = -132.0, -112.0  # height of the neckline in front and behind
THICK_MM, RAMP_MM = 2.2, 10.0  # of the cloth; over what height it comes
COLLAR_MM = 3.0  # the skin's colour ends so far down behind the collar
SHADED_MM, SHADE = (45.0, 9.0), (0.85, 0.3)  # above it: the rims, which shine up a neck; all light
WEAVE = 0.02  # unevenness of the cloth


def height(points: Floats) -> Floats:  # [n, 3] mm on the mean face -> [n] mm above the neckline
    share = np.clip((points[:, 2] + 40) / 100, 0, 1)
    sag = np.clip(np.abs(points[:, 0]) / 60, 0, 1) ** 2
    line = BACK_MM + (FRONT_MM - BACK_MM) * share * (1 - sag)
    return (points[:, 1] - line).astype(np.float32)


def worn(
    neutral: Floats,  # [V, 3] mm of the mean face, as below
    geometry: Floats,  # [V, 3] mm
    normals: Floats,  # [V, 3]
    skin: NDArray[np.bool_],  # [V]
) -> Floats:  # [V, 3]
    """The skin under the shirt pushed out: the cloth has a thickness."""
    under = np.clip(-height(neutral[skin]) / RAMP_MM, 0, 1)[:, None]
    out = geometry.copy()
    out[skin] += THICK_MM * under * normals[skin]
    return out


def cover(
    points: Floats,  # [N, 3] mm on the mean face
    on_skin: Floats,  # [N] 0..1
) -> Floats:  # [N] 0..1
    """Which Gaussians lie on the shirt."""
    return np.clip(0.5 - (height(points) + COLLAR_MM) / 1.2, 0, 1) * (on_skin > 0.99)


def shaded(
    visibility: Floats,  # [4, n] of sky, key light and rims
    points: Floats,  # [n, 3] mm on the mean face
) -> Floats:  # [4, n]
    """Skin above a collar, which stands in the light's way: else its edge shines."""
    above, out = height(points), visibility.copy()
    for rows, far, share in zip((slice(2, 4), slice(4)), SHADED_MM, SHADE, strict=True):
        near = np.clip(1 - above / far, 0, 1) * (above > 0)
        out[rows] *= (1 - share * near * near).astype(np.float32)
    return out


def dyed(
    albedo: Floats, cloth: Floats, color: tuple[float, float, float], rng: np.random.Generator
) -> Floats:
    uneven = 1 + WEAVE * rng.standard_normal((len(albedo), 1))
    shirt = np.array(color, np.float32) * uneven
    return (albedo + cloth[:, None] * (shirt - albedo)).astype(np.float32)
