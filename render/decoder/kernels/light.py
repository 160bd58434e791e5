"""Loops of the light on the skin, compiled by numba as those of `surface.py` are."""

# pyright: reportUntypedFunctionDecorator=false
import numpy as np

from render.decoder.kernels.surface import BLOCK, LIGHT, PLACE, SHARES, TURN
from render.decoder.kernels.vectors import loop
from render.types import Floats, Ints


@loop
def flush(
    sums: Floats,  # [n] mm^2
    rest_sums: Floats,  # [n] mm^2
    blood: Floats,  # [n] 1 where the colour changes, else 0
    color: Floats,  # [3] of a doubled area
    low: np.float32,
    high: np.float32,
    gains: Floats,  # -> [n, 3]
) -> None:
    one = np.float32(1)
    for n in range(len(sums)):
        stretch = (min(max(sums[n] / rest_sums[n], low), high) - one) * blood[n]
        for k in range(3):
            gains[n, k] = one + stretch * color[k]


@loop
def facing(axes: Floats, towards: Floats, cosine: Floats) -> None:  # [3, n], [3], -> [n]
    a, b, c = towards[0], towards[1], towards[2]
    xs, ys, zs = axes[0], axes[1], axes[2]
    for i in range(len(cosine)):
        cosine[i] = a * xs[i] + b * ys[i] + c * zs[i]


@loop
def vertex_attributes(
    first: int,  # used vertex, a multiple of BLOCK
    last: int,  # left out
    vertices: Floats,  # [V, 3] mm
    used: Ints,  # [U] vertices
    normals: Floats,  # [U, 3] unit
    seen: Floats,  # [4, U] shares of the sky, of the key light and the rims
    towards: Floats,  # [5, 3] unit, in the frame of the normals: the lamps, up
    lamps: Floats,  # [4, 3, 2] see Lighting.terms
    sky: Floats,  # [3, 2]
    bleed: Floats,  # [3]
    bounce: Floats,  # [3] share of the sky that is always seen
    behind: np.float32,  # see surface.normals_of
    move: Floats,  # [3, 4] of vertices and normals; light is that of moved ones already
    out: Floats,  # -> [U, CARRIED] what Gaussians take from a vertex, see `skin_gaussians`
) -> None:
    zero, one = np.float32(0), np.float32(1)
    a, b, c, left = move[0, 0], move[0, 1], move[0, 2], move[0, 3]
    e, f, g, up = move[1, 0], move[1, 1], move[1, 2], move[1, 3]
    h, j, o, front = move[2, 0], move[2, 1], move[2, 2], move[2, 3]
    axes, cosine = np.zeros((3, BLOCK), np.float32), np.empty(BLOCK, np.float32)
    shares, light = np.zeros((4, BLOCK), np.float32), np.empty((3, BLOCK), np.float32)
    for start in range(first, last, BLOCK):
        count = min(BLOCK, last - start)
        for i in range(count):
            n = np.uintp(start + i)
            axes[0, i], axes[1, i], axes[2, i] = normals[n, 0], normals[n, 1], normals[n, 2]
        for k in range(4):
            for i in range(count):  # a slice assigned takes five seconds more to compile
                shares[k, i] = seen[k, start + i]
        facing(axes, towards[4], cosine)
        for k in range(3):
            gain, offset, lit = sky[k, 0], sky[k, 1], light[k]
            for i in range(BLOCK):
                lit[i] = gain * cosine[i] + offset
        for lamp in (1, 0, 2, 3):  # the fill falls in with the sky
            facing(axes, towards[lamp], cosine)
            part = shares[0 if lamp == 1 else max(lamp, 1)]
            for k in range(3):
                gain, offset, lit = lamps[lamp, k, 0], lamps[lamp, k, 1], light[k]
                red, always = bleed[k], bounce[k]
                if lamp == 1:
                    for i in range(BLOCK):
                        sky_seen = part[i] * (one + red * (one - part[i]))
                        fill = max(gain * cosine[i] + offset, zero)
                        lit[i] = (lit[i] + fill) * (always + (one - always) * sky_seen)
                else:
                    for i in range(BLOCK):
                        bled = part[i] * (one + red * (one - part[i]))
                        lit[i] += max(gain * cosine[i] + offset, zero) * bled
        for i in range(count):
            n, m = np.uintp(start + i), np.uintp(i)
            v = np.uintp(used[n])
            x, y, z = vertices[v, 0], vertices[v, 1], vertices[v, 2]
            nx, ny, nz = axes[0, m], axes[1, m], axes[2, m]
            row = out[n]
            row[PLACE], row[PLACE + 1] = a * x + b * y + c * z + left, e * x + f * y + g * z + up
            row[PLACE + 2], row[PLACE + 3] = h * x + j * y + o * z + front, zero
            row[TURN], row[TURN + 1] = (
                h * nx + j * ny + o * nz + behind,
                -(e * nx + f * ny + g * nz),
            )
            row[TURN + 2], row[TURN + 3] = a * nx + b * ny + c * nz, zero
            row[LIGHT], row[LIGHT + 1], row[LIGHT + 2] = light[0, m], light[1, m], light[2, m]
            row[LIGHT + 3], row[SHARES], row[SHARES + 1] = zero, shares[1, m], shares[0, m]
            # `place_gaussian` computes with them, too: left as memory was, denormal numbers made a
            # decode take 12 ms instead of 2.5, in one process of four.
            row[SHARES + 2], row[SHARES + 3] = zero, zero


@loop
def gain_light(
    rows: Ints,  # [n] vertices
    gains: Floats,  # [n, 3]
    attributes: Floats,  # [U, CARRIED] see `vertex_attributes`; these rows changed in place
) -> None:
    for n in range(len(rows)):
        row = np.uintp(rows[n])
        for k in range(3):
            attributes[row, LIGHT + k] *= gains[n, k]


@loop
def activate(
    values: Floats,  # [n, C], changed in place
    bias: Floats,  # [n, C]
    slope: np.float32,  # below zero
) -> None:
    flat, add = values.reshape(-1), bias.reshape(-1)
    for i in range(len(flat)):
        x = flat[i] + add[i]
        flat[i] = max(x, slope * x)


@loop
def read_light(
    starts: Ints,  # [U + 1] a sparse map [U, texels] by rows
    texels: Ints,
    weights: Floats,
    least: Floats,  # [U] of the light at rest that is seen in any expression
    change: Floats,  # [texels, 2] since rest
    rest: Floats,  # [2, U] shares of light that are seen at rest
    out: Floats,  # -> [2, U] 0..1
) -> None:
    one = np.float32(1)
    for u in range(len(starts) - 1):
        sky, lamp = rest[0, u], rest[1, u]
        dark, shade = least[u] * sky, least[u] * lamp
        for e in range(np.uintp(starts[u]), np.uintp(starts[u + 1])):
            texel = np.uintp(texels[e])
            sky += weights[e] * change[texel, 0]
            lamp += weights[e] * change[texel, 1]
        out[0, u], out[1, u] = min(max(sky, dark), one), min(max(lamp, shade), one)
