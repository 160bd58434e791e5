"""Loops of the decoder: one pass over memory where numpy takes many.

numba compiles them on first use (seconds, once a machine) and keeps the result beside this file.
All run on one thread and add in a fixed order: the same input gives the same bits.
"""

# pyright: reportUntypedFunctionDecorator=false
import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float32]
Ints = NDArray[np.int32]


@njit(cache=True, nogil=True, error_model="numpy")
def around_vertices(
    vertices: Floats,  # [V, 3] mm
    corners: Ints,  # [F, 3] vertices of the triangles
    rows: Ints,  # [F, 3] where their corners are gathered, or -1
    normals: Floats,  # -> [n, 3] unit
    sums: Floats,  # -> [n] sum of twice the areas around it
    areas: Floats,  # -> [F] mm^2, twice those of the triangles
) -> None:
    normals[:] = 0
    sums[:] = 0
    for f in range(len(corners)):
        a, b, c = corners[f, 0], corners[f, 1], corners[f, 2]
        ax, ay, az = vertices[a, 0], vertices[a, 1], vertices[a, 2]
        bx, by, bz = vertices[b, 0] - ax, vertices[b, 1] - ay, vertices[b, 2] - az
        cx, cy, cz = vertices[c, 0] - ax, vertices[c, 1] - ay, vertices[c, 2] - az
        x, y, z = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
        area = np.sqrt(x * x + y * y + z * z)
        areas[f] = area
        for k in range(3):
            row = rows[f, k]
            if row >= 0:
                normals[row, 0] += x
                normals[row, 1] += y
                normals[row, 2] += z
                sums[row] += area
    for n in range(len(normals)):
        x, y, z = normals[n, 0], normals[n, 1], normals[n, 2]
        length = np.sqrt(x * x + y * y + z * z + np.float32(1e-12))
        for k in range(3):
            normals[n, k] /= length


@njit(cache=True, nogil=True, error_model="numpy")
def face(
    normals: Floats,  # [n, 3] unit
    rows: Ints,  # [n]
    behind: np.float32,
    quats: Floats,  # -> [U, 4] these rows; see surface.facing
) -> None:
    for n in range(len(normals)):
        row = rows[n]
        quats[row, 0] = normals[n, 2] + behind
        quats[row, 1] = -normals[n, 1]
        quats[row, 2] = normals[n, 0]
        quats[row, 3] = 0


@njit(cache=True, nogil=True, error_model="numpy")
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


@njit(cache=True, nogil=True, error_model="numpy")
def widen(
    areas: Floats,  # [F] mm^2
    triangles: Ints,  # [N] whose area an anchor's width follows, or -1
    rest_areas: Floats,  # [N] mm^2
    widths: Floats,  # [N] mm at `rest_areas`, where it follows
    still: Floats,  # [N] mm, where it does not
    low: np.float32,
    high: np.float32,
    flatness: np.float32,
    scales: Floats,  # -> [N, 3] mm
) -> None:
    for n in range(len(triangles)):
        width = still[n]
        if triangles[n] >= 0:
            stretch = np.sqrt(areas[triangles[n]] / rest_areas[n])
            width = widths[n] * min(max(stretch, low), high)
        scales[n, 0] = scales[n, 1] = width
        scales[n, 2] = width * flatness


@njit(cache=True, nogil=True, error_model="numpy")
def receive(
    normals: Floats,  # [n, 3] unit
    rows: Ints,  # [n]
    gains: Floats,  # [n, 3] of linear light
    towards: Floats,  # [4, 3] unit: fill, rim and key light; where the key light mirrors
    lamps: Floats,  # [3, 3, 2] of each light and channel: gain and offset over the cosine
    sky: Floats,  # [3, 2] the same over the height
    out: Floats,  # -> [U, 8] these rows; see Lighting.parts
) -> None:
    zero = np.float32(0)
    for n in range(len(normals)):
        x, y, z = normals[n, 0], normals[n, 1], normals[n, 2]
        row = rows[n]
        fill = towards[0, 0] * x + towards[0, 1] * y + towards[0, 2] * z
        rim = towards[1, 0] * x + towards[1, 1] * y + towards[1, 2] * z
        key = towards[2, 0] * x + towards[2, 1] * y + towards[2, 2] * z
        for k in range(3):
            total = sky[k, 0] * y + sky[k, 1]
            total += max(lamps[0, k, 0] * fill + lamps[0, k, 1], zero)
            total += max(lamps[1, k, 0] * rim + lamps[1, k, 1], zero)
            out[row, k] = gains[n, k] * total
            out[row, 3 + k] = gains[n, k] * max(lamps[2, k, 0] * key + lamps[2, k, 1], zero)
        half = towards[3, 0] * x + towards[3, 1] * y + towards[3, 2] * z
        half = max(half, np.float32(0.5))  # no denormals in its powers: slow
        half *= half  # ^2
        half *= half
        half *= half
        half *= half  # ^16
        out[row, 6] = half
        half *= half
        out[row, 7] = half * half


@njit(cache=True, nogil=True, error_model="numpy")
def shade(
    parts: Floats,  # [n, 8] see Lighting.parts
    shine: Floats,  # [2, n] weights of sheen and gloss
    seen: Floats,  # [2, n] shares of the sky and of the key light
    bounce: np.float32,  # share of the sky that is always seen
    out: Floats,  # -> [n, 4] linear red, green, blue on a white surface; shine
) -> None:
    for n in range(len(parts)):
        lit = seen[1, n]
        ambient = bounce + (np.float32(1) - bounce) * seen[0, n]
        for k in range(3):
            out[n, k] = parts[n, k] * ambient + parts[n, 3 + k] * lit
        out[n, 3] = (shine[0, n] * parts[n, 6] + shine[1, n] * parts[n, 7]) * lit


@njit(cache=True, nogil=True, error_model="numpy")
def read_light(
    starts: Ints,  # [U + 1] a sparse map [U, texels] by rows
    texels: Ints,
    weights: Floats,
    change: Floats,  # [texels, 2] since rest
    rest: Floats,  # [2, U] shares of light that are seen at rest
    out: Floats,  # -> [2, U] 0..1
) -> None:
    zero, one = np.float32(0), np.float32(1)
    for u in range(len(starts) - 1):
        sky, lamp = rest[0, u], rest[1, u]
        for e in range(starts[u], starts[u + 1]):
            texel = np.uintp(texels[e])
            sky += weights[e] * change[texel, 0]
            lamp += weights[e] * change[texel, 1]
        out[0, u], out[1, u] = min(max(sky, zero), one), min(max(lamp, zero), one)


@njit(cache=True, nogil=True, error_model="numpy")
def ride(
    vertices: Floats,  # [V, 3] mm
    quats: Floats,  # [U, 4]
    light: Floats,  # [U, 4]
    corners: Ints,  # [N, 3] vertices of the anchors' triangles, and ...
    rows: Ints,  # [N, 3] ... their rows of `quats` and `light`
    weights: Floats,  # [N, 3] barycentric coordinates
    out_means: Floats,  # -> [N, 3] mm
    out_quats: Floats,  # -> [N, 4]
    out_light: Floats,  # -> [N, 4]
) -> None:
    for n in range(len(corners)):
        p, q, r = weights[n, 0], weights[n, 1], weights[n, 2]
        a, b, c = corners[n, 0], corners[n, 1], corners[n, 2]
        for k in range(3):
            out_means[n, k] = p * vertices[a, k] + q * vertices[b, k] + r * vertices[c, k]
        a, b, c = rows[n, 0], rows[n, 1], rows[n, 2]
        for k in range(4):
            out_quats[n, k] = p * quats[a, k] + q * quats[b, k] + r * quats[c, k]
        for k in range(4):
            out_light[n, k] = p * light[a, k] + q * light[b, k] + r * light[c, k]


@njit(cache=True, nogil=True, error_model="numpy")
def paint(
    reflected: Floats,  # [N, 3] linear albedo
    light: Floats,  # [N, 4] linear red, green, blue on a white surface; shine
    colors: Floats,  # -> [N, 3] stored, 0..1
) -> None:
    for n in range(len(colors)):
        for k in range(3):
            value = reflected[n, k] * light[n, k] + light[n, 3]
            colors[n, k] = np.sqrt(min(max(value, np.float32(0)), np.float32(1)))
