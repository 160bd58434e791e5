"""What Gaussians mirror: one lobe each, for the lamps of `render/lighting.py` and one viewer.

Skin mirrors lamps where its normal lies half-way between lamp and viewer, so its colour depends on
where it is seen from: both eyes of a headset see another. Computed when a picture is drawn.
"""

# pyright: reportUntypedFunctionDecorator=false
import numpy as np
from numba import njit
from numpy.typing import NDArray

from render.lighting import FILM, HALF_WIDTHS, TOWARDS
from render.types import Floats, Gaussians

FRONT_MM = np.array([0.0, 15.0, 900.0], np.float32)  # where pictures are mostly taken from
F0, SPREAD = np.float32(0.028), np.float32(0.5)  # as in shaders/mesh.frag.glsl


def colors_from(cloud: Gaussians, viewer_mm: NDArray[np.floating] = FRONT_MM) -> Floats:  # [N, 3]
    """The stored colours as seen from a place [3]."""
    if cloud.shine is None:
        return cloud.colors
    out = cloud.colors.copy()
    shine, viewer = cloud.shine, np.asarray(viewer_mm, np.float32)
    lobes = (shine.weights, shine.roughness, shine.lamps, TOWARDS, HALF_WIDTHS * SPREAD)
    mirror(cloud.means, cloud.quats, *lobes, viewer, FILM, out)
    return out


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def mirror(
    means: Floats,  # [N, 3] mm
    quats: Floats,  # [N, 4] of the first M: z is turned to the normal
    weights: Floats,  # [M, 4] of each lamp
    roughness: Floats,  # [M]
    lamps: Floats,  # [4, 3] linear light
    towards: Floats,  # [4, 3] unit
    soft: Floats,  # [4] what the width of a lamp adds to the roughness
    viewer: Floats,  # [3] mm
    film: Floats,  # [5]
    colors: Floats,  # [N, 3] stored, changed in place
) -> None:
    zero, one, tiny = np.float32(0), np.float32(1), np.float32(1e-9)
    a, b, c, d, e = film[0], film[1], film[2], film[3], film[4]
    quarter, tenth, two, four = np.float32(0.25), np.float32(0.1), np.float32(2), np.float32(4)
    half = np.float32(0.5)
    for i in range(len(weights)):
        w, x, y, z = quats[i, 0], quats[i, 1], quats[i, 2], quats[i, 3]
        nx, ny, nz = two * (x * z + w * y), two * (y * z - w * x), w * w - x * x - y * y + z * z
        vx, vy, vz = viewer[0] - means[i, 0], viewer[1] - means[i, 1], viewer[2] - means[i, 2]
        facing = nx * vx + ny * vy + nz * vz
        if facing <= zero:
            continue
        turn = one / np.sqrt(nx * nx + ny * ny + nz * nz + tiny)
        nx, ny, nz = nx * turn, ny * turn, nz * turn
        near = one / np.sqrt(vx * vx + vy * vy + vz * vz + tiny)
        vx, vy, vz = vx * near, vy * near, vz * near
        red = green = blue = zero
        for k in range(4):
            lx, ly, lz = towards[k, 0], towards[k, 1], towards[k, 2]
            nl = nx * lx + ny * ly + nz * lz
            if nl <= zero:
                continue
            hx, hy, hz = lx + vx, ly + vy, lz + vz
            length = hx * hx + hy * hy + hz * hz + tiny  # 2 + 2 cos = 4 (l . h)^2
            lh2 = length * quarter
            nh = (nx * hx + ny * hy + nz * hz) / np.sqrt(length)
            rough = min(roughness[i] + soft[k], one)
            r2 = rough * rough
            a2 = r2 * r2
            spread = nh * nh * (a2 - one) + one
            out = one - np.sqrt(lh2)
            fresnel = F0 + (one - F0) * out * out * out * out * out
            light = weights[i, k] * a2 * fresnel * nl
            light /= spread * spread * four * max(lh2, tenth) * (rough + half)
            red += light * lamps[k, 0]
            green += light * lamps[k, 1]
            blue += light * lamps[k, 2]
        for k in range(3):
            more = red if k == 0 else green if k == 1 else blue
            r = colors[i, k] * colors[i, k]  # x (a x + b) / (x (c x + d) + e), solved for x
            p, q = a - c * r, b - d * r
            x = more + (np.sqrt(q * q + four * p * e * r) - q) / (two * p)
            x = x * (a * x + b) / (x * (c * x + d) + e)
            colors[i, k] = np.sqrt(min(x, one))
