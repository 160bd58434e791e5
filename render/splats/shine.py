"""What Gaussians mirror: one lobe each, for the lamps of `render/lighting.py` and one viewer.

Skin mirrors lamps where its normal lies half-way between lamp and viewer, so its colour depends on
where it is seen from: both eyes of a headset see another. Computed when a picture is drawn, in
passes over flat arrays, which numba makes vector code of.
"""

# pyright: reportUntypedFunctionDecorator=false
import numpy as np
from numba import njit
from numpy.typing import NDArray

from render.lighting import FILM, HALF_WIDTHS, TOWARDS
from render.types import Floats, Gaussians

FRONT_MM = np.array([0.0, 15.0, 900.0], np.float32)  # where pictures are mostly taken from
FAST = {"cache": True, "nogil": True, "error_model": "numpy"}
FUSED = {**FAST, "fastmath": {"contract"}}  # a product and its sum are rounded once
F0, SOFT = np.float32(0.028), HALF_WIDTHS * np.float32(0.5)  # as in shaders/mesh.frag.glsl
ZERO, ONE, TWO, FOUR = np.float32(0), np.float32(1), np.float32(2), np.float32(4)
TINY, TENTH = np.float32(1e-9), np.float32(0.1)
QUARTER, HALF = np.float32(0.25), np.float32(0.5)


def colors_from(cloud: Gaussians, viewer_mm: NDArray[np.floating] = FRONT_MM) -> Floats:  # [N, 3]
    """The stored colours as seen from a place [3]."""
    shine = cloud.shine
    if shine is None:
        return cloud.colors
    means, quats = (np.ascontiguousarray(rows).reshape(-1) for rows in (cloud.means, cloud.quats))
    out = np.array(cloud.colors, np.float32, order="C")
    viewer, weights = np.asarray(viewer_mm, np.float32), np.ascontiguousarray(shine.weights)
    lamps = SOFT, TOWARDS, shine.lamps, FILM
    add_shine(means, quats, viewer, weights.reshape(-1), shine.roughness, *lamps, out.reshape(-1))
    return out


@njit(**FUSED)
def face_viewer(
    means: Floats,  # [N * 3] mm
    quats: Floats,  # [N * 4] of the first M: z is turned to the normal
    viewer: Floats,  # [3] mm
    sides: Floats,  # -> [7, M] unit normals, 0 where they face away; unit, towards the viewer; its
    # cosine to the normal
) -> None:
    px, py, pz = viewer[0], viewer[1], viewer[2]
    nx, ny, nz, vx, vy, vz, nv = (
        sides[0], sides[1], sides[2], sides[3], sides[4], sides[5], sides[6]
    )  # fmt: skip
    for i in range(len(nx)):
        w, x, y, z = quats[4 * i], quats[4 * i + 1], quats[4 * i + 2], quats[4 * i + 3]
        a, b, c = TWO * (x * z + w * y), TWO * (y * z - w * x), w * w - x * x - y * y + z * z
        d, e, f = px - means[3 * i], py - means[3 * i + 1], pz - means[3 * i + 2]
        turn = ONE / np.sqrt(a * a + b * b + c * c + TINY)
        towards = a * d + b * e + c * f
        turn = turn if towards > ZERO else ZERO
        near = ONE / np.sqrt(d * d + e * e + f * f + TINY)
        nx[i], ny[i], nz[i] = a * turn, b * turn, c * turn
        vx[i], vy[i], vz[i] = d * near, e * near, f * near
        nv[i] = towards * turn * near


@njit(**FUSED)
def by_lamp(weights: Floats, lamps: Floats) -> None:  # [M * 4] -> [4, M]
    first, second, third, fourth = lamps[0], lamps[1], lamps[2], lamps[3]
    for i in range(len(first)):
        first[i], second[i] = weights[4 * i], weights[4 * i + 1]
        third[i], fourth[i] = weights[4 * i + 2], weights[4 * i + 3]


@njit(**FUSED)
def add_lobe(
    sides: Floats,  # [7, M] see face_viewer
    weights: Floats,  # [M] of this lamp
    roughness: Floats,  # [M]
    wide: np.float32,  # what the width of the lamp adds to it
    towards: Floats,  # [3] unit
    lamp: Floats,  # [3] linear light
    added: Floats,  # -> [3, M] linear light, added to
) -> None:
    lx, ly, lz = towards[0], towards[1], towards[2]
    lamp_red, lamp_green, lamp_blue = lamp[0], lamp[1], lamp[2]
    nx, ny, nz, vx, vy, vz, nv = (
        sides[0], sides[1], sides[2], sides[3], sides[4], sides[5], sides[6]
    )  # fmt: skip
    red, green, blue = added[0], added[1], added[2]
    for i in range(len(weights)):
        nl = max(nx[i] * lx + ny[i] * ly + nz[i] * lz, ZERO)
        nh = nl + nv[i]  # of l + v, which is the half-way vector, but longer
        length = TWO + TWO * (lx * vx[i] + ly * vy[i] + lz * vz[i]) + TINY  # its square
        lh2 = length * QUARTER
        rough = min(roughness[i] + wide, ONE)
        r2 = rough * rough
        a2 = r2 * r2
        spread = nh * nh * (a2 - ONE) + length
        out = ONE - np.sqrt(lh2)
        out2 = out * out
        fresnel = F0 + (ONE - F0) * (out2 * out2 * out)
        light = weights[i] * a2 * fresnel * nl * (length * length)
        light /= spread * spread * FOUR * max(lh2, TENTH) * (rough + HALF)
        red[i] += light * lamp_red
        green[i] += light * lamp_green
        blue[i] += light * lamp_blue


@njit(**FUSED)
def add_light(
    added: Floats,  # [3, M] linear light
    film: Floats,  # [5]
    colors: Floats,  # [N * 3] stored; changed in place
) -> None:
    a, b, c, d, e = film[0], film[1], film[2], film[3], film[4]
    red, green, blue = added[0], added[1], added[2]
    for i in range(len(red)):
        colors[3 * i] = _lit(colors[3 * i], red[i], a, b, c, d, e)
        colors[3 * i + 1] = _lit(colors[3 * i + 1], green[i], a, b, c, d, e)
        colors[3 * i + 2] = _lit(colors[3 * i + 2], blue[i], a, b, c, d, e)


@njit(**FUSED)
def _lit(stored, light, a, b, c, d, e):  # noqa: ANN001, ANN202
    """A stored colour with more light, of a film."""
    r = stored * stored  # x (a x + b) / (x (c x + d) + e), solved for x
    p, q = a - c * r, b - d * r
    x = light + (np.sqrt(q * q + FOUR * p * e * r) - q) / (TWO * p)
    x = x * (a * x + b) / (x * (c * x + d) + e)
    return np.sqrt(min(x, ONE)) if light > ZERO else stored


@njit(**FUSED)
def add_shine(
    means: Floats,  # [N * 3] mm
    quats: Floats,  # [N * 4]
    viewer: Floats,  # [3] mm
    weights: Floats,  # [M * 4] of the first M, see Shine
    roughness: Floats,  # [M]
    soft: Floats,  # [4] what the width of each lamp adds to it
    towards: Floats,  # [4, 3] unit
    lamps: Floats,  # [4, 3] linear light
    film: Floats,  # [5]
    colors: Floats,  # [N * 3] stored, changed in place
) -> None:
    count = len(roughness)
    sides, added = np.empty((7, count), np.float32), np.zeros((3, count), np.float32)
    of_lamps = np.empty((4, count), np.float32)
    face_viewer(means, quats, viewer, sides)
    by_lamp(weights, of_lamps)
    for k in range(len(towards)):
        add_lobe(sides, of_lamps[k], roughness, soft[k], towards[k], lamps[k], added)
    add_light(added, film, colors)
