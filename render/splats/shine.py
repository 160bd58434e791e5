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


@njit(**FAST)
def face_viewer(
    means: Floats,  # [N * 3] mm
    quats: Floats,  # [N * 4] of the first M: z is turned to the normal
    viewer: Floats,  # [3] mm
    nx: Floats,  # -> [M] unit normals, 0 where they face away
    ny: Floats,
    nz: Floats,
    vx: Floats,  # -> [M] unit, towards the viewer
    vy: Floats,
    vz: Floats,
) -> None:
    px, py, pz = viewer[0], viewer[1], viewer[2]
    for i in range(len(nx)):
        w, x, y, z = quats[4 * i], quats[4 * i + 1], quats[4 * i + 2], quats[4 * i + 3]
        a, b, c = TWO * (x * z + w * y), TWO * (y * z - w * x), w * w - x * x - y * y + z * z
        d, e, f = px - means[3 * i], py - means[3 * i + 1], pz - means[3 * i + 2]
        turn = ONE / np.sqrt(a * a + b * b + c * c + TINY)
        turn = turn if a * d + b * e + c * f > ZERO else ZERO
        near = ONE / np.sqrt(d * d + e * e + f * f + TINY)
        nx[i], ny[i], nz[i] = a * turn, b * turn, c * turn
        vx[i], vy[i], vz[i] = d * near, e * near, f * near


@njit(**FAST)
def add_lobe(
    nx: Floats,  # [M] see face_viewer
    ny: Floats,
    nz: Floats,
    vx: Floats,
    vy: Floats,
    vz: Floats,
    weights: Floats,  # every fourth is this lamp's
    roughness: Floats,  # [M]
    soft: Floats,  # first: what the width of the lamp adds to it
    towards: Floats,  # [3] unit
    lamp: Floats,  # [3] linear light
    red: Floats,  # -> [M] linear light, added to
    green: Floats,
    blue: Floats,
) -> None:
    lx, ly, lz = towards[0], towards[1], towards[2]
    wide, lamp_red, lamp_green, lamp_blue = soft[0], lamp[0], lamp[1], lamp[2]
    for i in range(len(nx)):
        hx, hy, hz = lx + vx[i], ly + vy[i], lz + vz[i]
        length = hx * hx + hy * hy + hz * hz + TINY  # 2 + 2 cos = 4 (l . h)^2
        lh2 = length * QUARTER
        nl = max(nx[i] * lx + ny[i] * ly + nz[i] * lz, ZERO)
        nh = nx[i] * hx + ny[i] * hy + nz[i] * hz
        rough = min(roughness[i] + wide, ONE)
        r2 = rough * rough
        a2 = r2 * r2
        spread = nh * nh / length * (a2 - ONE) + ONE
        out = ONE - np.sqrt(lh2)
        fresnel = F0 + (ONE - F0) * (out * out * out * out * out)
        light = weights[4 * i] * a2 * fresnel * nl
        light /= spread * spread * FOUR * max(lh2, TENTH) * (rough + HALF)
        red[i] += light * lamp_red
        green[i] += light * lamp_green
        blue[i] += light * lamp_blue


@njit(**FAST)
def add_light(
    light: Floats,  # [M] linear, of one colour
    film: Floats,  # [5]
    colors: Floats,  # every third is this colour, stored; changed in place
) -> None:
    a, b, c, d, e = film[0], film[1], film[2], film[3], film[4]
    for i in range(len(light)):
        stored = colors[3 * i]
        r = stored * stored  # x (a x + b) / (x (c x + d) + e), solved for x
        p, q = a - c * r, b - d * r
        x = light[i] + (np.sqrt(q * q + FOUR * p * e * r) - q) / (TWO * p)
        x = x * (a * x + b) / (x * (c * x + d) + e)
        colors[3 * i] = np.sqrt(min(x, ONE)) if light[i] > ZERO else stored


@njit(**FAST)
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
    sides = np.empty((6, len(roughness)), np.float32)
    nx, ny, nz, vx, vy, vz = sides[0], sides[1], sides[2], sides[3], sides[4], sides[5]
    added = np.zeros((3, len(roughness)), np.float32)
    red, green, blue = added[0], added[1], added[2]
    face_viewer(means, quats, viewer, nx, ny, nz, vx, vy, vz)
    for k in range(len(towards)):
        weight, wide, lamp = weights[k:], soft[k:], lamps[k]
        add_lobe(
            nx, ny, nz, vx, vy, vz, weight, roughness, wide, towards[k], lamp, red, green, blue
        )  # fmt: skip
    for k in range(3):
        add_light(added[k], film, colors[k:])
