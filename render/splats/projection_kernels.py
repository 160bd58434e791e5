"""Gaussians -> splats on a CPU: passes over flat float32 arrays, which numba makes vector code of.

One loop that does it all has too many arrays for that, and takes five times as long. Both GL
renderers draw its splats; the oracle is render/splats/reference.py.
"""

# pyright: reportUntypedFunctionDecorator=false
import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from render.splats import reference
from render.splats.shine import FAST, HALF, ONE, TWO, ZERO
from render.types import U32, Floats

TILE_PX = 8
# Depths of undrawn splats.
HIDDEN, BROKEN = np.float32(3.0e38), np.float32(3.2e38)
# -log2 of the faintest alpha that is drawn, as in shaders/splat.glsl
FAINTEST = np.float32(-math.log2(reference.MIN_ALPHA))
MIN_ALPHA, MAX_ALPHA = np.float32(reference.MIN_ALPHA), np.float32(reference.MAX_ALPHA)
LOW_PASS = np.float32(reference.LOW_PASS_PX2)
HALF_LOG2_E = np.float32(0.5 / math.log(2.0))
STRAND = np.float32(reference.STRAND)
TRANSPARENT, LOG2_E = np.float32(1e-6), np.float32(1 / math.log(2.0))
ROOT_OF_HALF = np.int32(0x3F3504F3)  # its bits
LOG = (
    7.0376836e-2, -1.1514610e-1, 1.1676999e-1, -1.2420141e-1, 1.4249323e-1, -1.6668057e-1,
    2.0000714e-1, -2.4999994e-1, 3.3333331e-1,
)  # fmt: skip
LOG = tuple(np.float32(number) for number in LOG)
TILES_A_PX = np.float32(0.125)
THIN, VAST, WIDE = np.float32(1e-6), np.float32(1e18), np.float32(1e9)


@njit(**FAST)
def project_means(
    means: Floats,  # [N * 3] mm
    view: Floats,  # [12] rows of world to camera
    lens: Floats,  # [8] focal x, y; centre x, y (px); least and most slope x, y of the Jacobian
    x: Floats,  # -> [N] px
    y: Floats,
    depth: Floats,  # -> [N] mm
    slope_x: Floats,  # -> [N]
    slope_y: Floats,
) -> None:
    v00, v01, v02, v03 = view[0], view[1], view[2], view[3]
    v10, v11, v12, v13 = view[4], view[5], view[6], view[7]
    v20, v21, v22, v23 = view[8], view[9], view[10], view[11]
    focal_x, focal_y, centre_x, centre_y = lens[0], lens[1], lens[2], lens[3]
    low_x, high_x, low_y, high_y = lens[4], lens[5], lens[6], lens[7]
    for i in range(len(x)):
        a, b, c = means[3 * i], means[3 * i + 1], means[3 * i + 2]
        z = v20 * a + v21 * b + v22 * c + v23
        u = (v00 * a + v01 * b + v02 * c + v03) / z
        v = (v10 * a + v11 * b + v12 * c + v13) / z
        depth[i] = z
        x[i], y[i] = u * focal_x + centre_x, v * focal_y + centre_y
        slope_x[i] = min(max(u, low_x), high_x)
        slope_y[i] = min(max(v, low_y), high_y)


@njit(**FAST)
def fade(
    opacities: Floats,  # [N]
    scales: Floats,  # [N * 3] mm
    focal: np.float32,  # px
    depth: Floats,  # [N] mm
    faded: Floats,  # -> [N] opacities of strands, less what the low-pass filter widens them
) -> None:
    for i in range(len(depth)):
        x, y, z = scales[3 * i], scales[3 * i + 1], scales[3 * i + 2]
        length = max(max(x, y), z)
        width = max(min(x, y), min(max(x, y), z))
        px = width * focal / depth[i]
        share = np.sqrt(px * px / (px * px + LOW_PASS))
        faded[i] = opacities[i] * (share if length > STRAND * width else ONE)


@njit(**FAST)
def log2_of(
    faded: Floats,  # [N]
    log2_opacity: Floats,  # -> [N] of opacities that are neither 0 nor 1
) -> None:
    """Exponents and mantissas 0.7 .. 1.4, and a polynomial of Cephes, to a ten-millionth."""
    for i in range(len(faded)):
        log2_opacity[i] = min(max(faded[i], TRANSPARENT), MAX_ALPHA)
    bits, rest = log2_opacity.view(np.int32), np.empty(len(faded), np.int32)
    mantissas, exponents = rest.view(np.float32), np.empty(len(faded), np.float32)
    for i in range(len(faded)):
        exponent = (bits[i] - ROOT_OF_HALF) >> np.int32(23)
        exponents[i] = np.float32(exponent)
        rest[i] = bits[i] - (exponent << np.int32(23))
    for i in range(len(faded)):
        x = mantissas[i] - ONE
        y = LOG[0]
        for k in range(1, len(LOG)):
            y = y * x + LOG[k]
        log2_opacity[i] = exponents[i] + (x - HALF * x * x + y * x * x * x) * LOG2_E


@njit(**FAST)
def project_covariances(
    quats: Floats,  # [N * 4] wxyz
    scales: Floats,  # [N * 3] mm
    view: Floats,
    lens: Floats,
    depth: Floats,
    slope_x: Floats,
    slope_y: Floats,
    var_x: Floats,  # -> [N] px^2
    var_y: Floats,
    cov: Floats,
) -> None:
    """Rows of the Jacobian, in the world, times the axes of the Gaussian."""
    v00, v01, v02 = view[0], view[1], view[2]
    v10, v11, v12 = view[4], view[5], view[6]
    v20, v21, v22 = view[8], view[9], view[10]
    focal_x, focal_y = lens[0], lens[1]
    for i in range(len(depth)):
        w, x, y, z = quats[4 * i], quats[4 * i + 1], quats[4 * i + 2], quats[4 * i + 3]
        twice = TWO / (w * w + x * x + y * y + z * z)
        wx, wy, wz = twice * w * x, twice * w * y, twice * w * z
        xx, xy, xz = twice * x * x, twice * x * y, twice * x * z
        yy, yz, zz = twice * y * y, twice * y * z, twice * z * z
        inverse, u, v = ONE / depth[i], slope_x[i], slope_y[i]
        s = focal_x * inverse
        jx, jy, jz = s * (v00 - u * v20), s * (v01 - u * v21), s * (v02 - u * v22)
        s = focal_y * inverse
        kx, ky, kz = s * (v10 - v * v20), s * (v11 - v * v21), s * (v12 - v * v22)
        s, ax, ay, az = scales[3 * i], ONE - yy - zz, xy + wz, xz - wy
        xa, ya = s * (jx * ax + jy * ay + jz * az), s * (kx * ax + ky * ay + kz * az)
        s, ax, ay, az = scales[3 * i + 1], xy - wz, ONE - xx - zz, yz + wx
        xb, yb = s * (jx * ax + jy * ay + jz * az), s * (kx * ax + ky * ay + kz * az)
        s, ax, ay, az = scales[3 * i + 2], xz + wy, yz - wx, ONE - xx - yy
        xc, yc = s * (jx * ax + jy * ay + jz * az), s * (kx * ax + ky * ay + kz * az)
        var_x[i] = xa * xa + xb * xb + xc * xc + LOW_PASS
        var_y[i] = ya * ya + yb * yb + yc * yc + LOW_PASS
        cov[i] = xa * ya + xb * yb + xc * yc


@njit(**FAST)
def invert(
    var_x: Floats,  # [N]
    var_y: Floats,
    cov: Floats,
    p: Floats,  # -> [N] the Cholesky factor of the inverse covariance, see shaders/splat.glsl
    q: Floats,
    r: Floats,
) -> None:
    for i in range(len(p)):
        k = cov[i] / var_y[i]
        p[i] = np.sqrt(HALF_LOG2_E / max(var_x[i] - k * cov[i], THIN))
        q[i] = -p[i] * k
        r[i] = np.sqrt(HALF_LOG2_E / var_y[i])


@njit(**FAST)
def bound(
    x: Floats,  # [N]
    y: Floats,
    var_x: Floats,
    var_y: Floats,
    log2_opacity: Floats,
    across: np.float32,  # tiles
    down: np.float32,
    half_y: Floats,  # -> [N] px, half of the box's height
    boxes: U32,  # -> [N * 2] tiles: x0 | y0 << 16 and, excluded, x1 | y1 << 16
) -> None:
    for i in range(len(x)):
        spread = max(log2_opacity[i] + FAINTEST, ZERO) * (ONE / HALF_LOG2_E)
        w, h = np.sqrt(spread * var_x[i]), np.sqrt(spread * var_y[i])
        half_y[i] = h
        x0 = np.int32(np.floor(min(max((x[i] - w) * TILES_A_PX, ZERO), across)))
        y0 = np.int32(np.floor(min(max((y[i] - h) * TILES_A_PX, ZERO), down)))
        x1 = np.int32(np.ceil(min(max((x[i] + w) * TILES_A_PX, ZERO), across)))
        y1 = np.int32(np.ceil(min(max((y[i] + h) * TILES_A_PX, ZERO), down)))
        boxes[2 * i], boxes[2 * i + 1] = x0 | y0 << 16, x1 | y1 << 16


@njit(**FAST)
def cull(
    means: Floats,
    quats: Floats,
    scales: Floats,
    opacities: Floats,
    faded: Floats,
    colors: Floats,
    boxes: U32,
    near_mm: np.float32,
    depth: Floats,  # [N] mm -> HIDDEN outside the picture, BROKEN where no picture can show it
) -> None:
    """Comparisons with NaN fail."""
    for i in range(len(depth)):
        x, y, z = means[3 * i], means[3 * i + 1], means[3 * i + 2]
        far = abs(x) + abs(y) + abs(z)
        x, y, z = quats[4 * i + 1], quats[4 * i + 2], quats[4 * i + 3]
        turn = abs(quats[4 * i]) + abs(x) + abs(y) + abs(z)
        x, y, z = scales[3 * i], scales[3 * i + 1], scales[3 * i + 2]
        size, least = x + y + z, min(min(x, y), z)
        x, y, z = colors[3 * i], colors[3 * i + 1], colors[3 * i + 2]
        bright = abs(x) + abs(y) + abs(z)
        sound = (far < VAST) & (turn > ONE / VAST) & (turn < VAST) & (bright < VAST)
        sound &= (least >= ZERO) & (size > ZERO) & (size < WIDE)
        sound &= (opacities[i] >= MIN_ALPHA) & (opacities[i] < VAST)
        low, high = boxes[2 * i], boxes[2 * i + 1]
        inside = ((low & 0xFFFF) < (high & 0xFFFF)) & ((low >> 16) < (high >> 16))
        inside &= (depth[i] >= near_mm) & (faded[i] >= MIN_ALPHA)
        depth[i] = (depth[i] if inside else HIDDEN) if sound else BROKEN


@njit(**FAST)
def pack(
    x: Floats,  # [N]
    y: Floats,
    p: NDArray[np.int32],  # [N] bits of the floats
    q: NDArray[np.int32],
    r: NDArray[np.int32],
    log2_opacity: Floats,
    colors: Floats,  # [N * 3]
    splats: U32,  # -> [N * 4] as `pack` of shaders/splat.glsl
) -> None:
    least, ten, twenty = np.float32(0), np.float32(1023), np.float32(1048575)
    for i in range(len(x)):
        at_x = np.int32(min(max((x[i] + np.float32(2048)) * np.float32(128), least), twenty) + HALF)
        at_y = np.int32(min(max((y[i] + np.float32(2048)) * np.float32(128), least), twenty) + HALF)
        red = np.int32(min(max(colors[3 * i] * ten, least), ten) + HALF)
        green = np.int32(min(max(colors[3 * i + 1] * ten, least), ten) + HALF)
        blue = np.int32(min(max(colors[3 * i + 2] * ten, least), ten) + HALF)
        faint = np.int32(min(max(log2_opacity[i] * (-ten / FAINTEST), least), ten) + HALF)
        p16 = min(max(p[i] + 0x800 - (97 << 23), 0) >> 12, 0xFFFF)
        r16 = min(max(r[i] + 0x800 - (97 << 23), 0) >> 12, 0xFFFF)
        q16 = min(max((q[i] & 0x7FFFFFFF) + 0x800 - (114 << 23), 0) >> 12, 0x7FFF)
        splats[4 * i] = p16 | q16 << 16 | (q[i] & -0x80000000)
        splats[4 * i + 1] = r16 | faint << 16 | blue >> 4 << 26
        splats[4 * i + 2] = at_x << 12 | red << 2 | blue >> 2 & 3
        splats[4 * i + 3] = at_y << 12 | green << 2 | blue & 3
