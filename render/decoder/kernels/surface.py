"""Loops of the decoder: one pass over memory where numpy takes many.

numba compiles them on first use (seconds, once a machine) and keeps the result beside this file.
All run on one thread and add in a fixed order: the same input gives the same bits.
Cross products and rotations are written out in each loop, as plain scalars of one pass.
"""

# pyright: reportUntypedFunctionDecorator=false
import numpy as np
from numba import njit

from render.types import Floats, Ints, Shorts


@njit(cache=True, nogil=True, error_model="numpy")
def around_vertices(
    vertices: Floats,  # [V, 3] mm
    corners: Shorts,  # [F, 3] vertices of the triangles
    rows: Shorts,  # [F, 3] where their corners are gathered; n: nowhere
    totals: Floats,  # -> [n + 1, 4] normals times twice the areas around a vertex; these areas
    areas: Floats,  # -> [F + 1] mm^2, twice those of the triangles; 1
) -> None:
    totals[:] = 0
    areas[len(corners)] = 1
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
            totals[row, 0] += x
            totals[row, 1] += y
            totals[row, 2] += z
            totals[row, 3] += area


@njit(cache=True, nogil=True, error_model="numpy")
def normalise(
    totals: Floats,  # [n + 1, 4] see around_vertices
    normals: Floats,  # -> [n, 3] unit
) -> None:
    for n in range(len(normals)):
        x, y, z = totals[n, 0], totals[n, 1], totals[n, 2]
        length = np.sqrt(x * x + y * y + z * z + np.float32(1e-12))
        for k in range(3):
            normals[n, k] = totals[n, k] / length


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
def vertex_attributes(
    vertices: Floats,  # [V, 3] mm
    used: Ints,  # [U] vertices
    rows: Ints,  # [n] of `used`
    normals: Floats,  # [n, 3] unit
    parts: Floats,  # [n, 12] see Lighting.parts
    seen: Floats,  # [4, U] shares of the sky, of the key light and the rims
    bleed: Floats,  # [3]
    bounce: Floats,  # [3] share of the sky that is always seen
    behind: np.float32,  # see surface.normals_of
    move: Floats,  # [3, 4] of vertices and normals; light is that of moved ones already
    out: Floats,  # -> [U, 11] these rows: what Gaussians take from a vertex, see `skin_gaussians`
) -> None:
    one = np.float32(1)
    for n in range(len(rows)):
        row = np.uintp(rows[n])
        v = np.uintp(used[row])
        sky, key, left, right = seen[0, row], seen[1, row], seen[2, row], seen[3, row]
        x, y, z = vertices[v, 0], vertices[v, 1], vertices[v, 2]
        nx, ny, nz = normals[n, 0], normals[n, 1], normals[n, 2]
        for k in range(3):
            out[row, k] = move[k, 0] * x + move[k, 1] * y + move[k, 2] * z + move[k, 3]
            out[row, 5 - k] = move[k, 0] * nx + move[k, 1] * ny + move[k, 2] * nz
            b = bleed[k]
            ambient = bounce[k] + (one - bounce[k]) * sky * (one + b * (one - sky))
            light = parts[n, k] * ambient + parts[n, 3 + k] * key * (one + b * (one - key))
            light += parts[n, 6 + k] * left * (one + b * (one - left))
            out[row, 6 + k] = light + parts[n, 9 + k] * right * (one + b * (one - right))
        out[row, 3] += behind
        out[row, 4] = -out[row, 4]
        out[row, 9], out[row, 10] = key, sky


@njit(cache=True, nogil=True, error_model="numpy")
def activate(
    values: Floats,  # [n, C], changed in place
    bias: Floats,  # [n, C]
    slope: np.float32,  # below zero
) -> None:
    flat, add = values.reshape(-1), bias.reshape(-1)
    for i in range(len(flat)):
        x = flat[i] + add[i]
        flat[i] = max(x, slope * x)


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
        for e in range(np.uintp(starts[u]), np.uintp(starts[u + 1])):
            texel = np.uintp(texels[e])
            sky += weights[e] * change[texel, 0]
            lamp += weights[e] * change[texel, 1]
        out[0, u], out[1, u] = min(max(sky, zero), one), min(max(lamp, zero), one)


@njit(cache=True, nogil=True, error_model="numpy")
def skin_gaussians(
    attributes: Floats,  # [U, 11] place, mm; three of a turn's wxyz; light; shares of key, sky
    rows: Shorts,  # [N, 3] vertices of the anchors' triangles
    weights: Floats,  # [N, 3] barycentric coordinates
    areas: Floats,  # [F + 1] mm^2
    triangles: Shorts,  # [N] whose area an anchor's width follows
    rest_areas: Floats,  # [N] mm^2
    widths: Floats,  # [N] mm at `rest_areas`
    reflected: Floats,  # [N, 3] linear albedo
    gloss: Floats,  # [N, 3] weight of mirrored light; the same times the shares of both rims
    depths: Floats,  # [N] mm under the skin
    film: Floats,  # [5] see lighting.FILM, with the exposure
    low: np.float32,
    high: np.float32,
    flatness: np.float32,
    behind: np.float32,  # see surface.normals_of
    means: Floats,  # -> [N, 3] mm
    quats: Floats,  # -> [N, 4]
    scales: Floats,  # -> [N, 3] mm
    colors: Floats,  # -> [N, 3] stored, 0..1, without mirrored light
    shine: Floats,  # -> [N, 4] weight of the mirrored light of each lamp
) -> None:
    zero, one = np.float32(0), np.float32(1)
    for n in range(len(rows)):
        p, q, r = weights[n, 0], weights[n, 1], weights[n, 2]
        a, b, c = rows[n, 0], rows[n, 1], rows[n, 2]
        for k in range(3):
            means[n, k] = p * attributes[a, k] + q * attributes[b, k] + r * attributes[c, k]
        for k in range(3):
            t = 3 + k
            quats[n, k] = p * attributes[a, t] + q * attributes[b, t] + r * attributes[c, t]
        quats[n, 3] = zero
        if depths[n] > zero:
            means[n, 0] -= depths[n] * quats[n, 2]
            means[n, 1] += depths[n] * quats[n, 1]
            means[n, 2] -= depths[n] * (quats[n, 0] - behind)
        for k in range(3):
            t = 6 + k
            light = p * attributes[a, t] + q * attributes[b, t] + r * attributes[c, t]
            x = max(reflected[n, k] * light, zero)
            x = x * (film[0] * x + film[1]) / (x * (film[2] * x + film[3]) + film[4])
            colors[n, k] = np.sqrt(min(x, one))
        key = p * attributes[a, 9] + q * attributes[b, 9] + r * attributes[c, 9]
        sky = p * attributes[a, 10] + q * attributes[b, 10] + r * attributes[c, 10]
        shine[n, 0], shine[n, 1] = gloss[n, 0] * key, gloss[n, 0] * sky
        shine[n, 2], shine[n, 3] = gloss[n, 1], gloss[n, 2]
        stretch = np.sqrt(areas[triangles[n]] / rest_areas[n])
        width = widths[n] * min(max(stretch, low), high)
        scales[n, 0] = scales[n, 1] = width
        scales[n, 2] = width * flatness


@njit(cache=True, nogil=True, error_model="numpy")
def attach(
    vertices: Floats,  # [V, 3] mm
    corners: Shorts,  # [B, 3] vertices of the triangles that strands stand on
    shares: Floats,  # [B, 3] barycentric coordinates of their roots
    offsets: Floats,  # [B, 3] mm from the root, in the triangle's frame
    along: Floats,  # [B, 3] unit, the same frame
    behind: np.float32,  # see surface.normals_of
    means: Floats,  # -> [B, 3] mm
    quats: Floats,  # -> [B, 4] the shortest turn from x to the strand, of any length
) -> None:
    tiny = np.float32(1e-12)
    for n in range(len(corners)):
        a, b, c = corners[n, 0], corners[n, 1], corners[n, 2]
        ax, ay, az = vertices[a, 0], vertices[a, 1], vertices[a, 2]
        bx, by, bz = vertices[b, 0] - ax, vertices[b, 1] - ay, vertices[b, 2] - az
        cx, cy, cz = vertices[c, 0] - ax, vertices[c, 1] - ay, vertices[c, 2] - az
        x, y, z = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
        long, area = np.sqrt(bx * bx + by * by + bz * bz), np.sqrt(x * x + y * y + z * z)
        ux, uy, uz = bx / (long + tiny), by / (long + tiny), bz / (long + tiny)
        wx, wy, wz = x / (area + tiny), y / (area + tiny), z / (area + tiny)
        vx, vy, vz = wy * uz - wz * uy, wz * ux - wx * uz, wx * uy - wy * ux
        q, r = shares[n, 1], shares[n, 2]
        d, e, f = offsets[n, 0], offsets[n, 1], offsets[n, 2]
        means[n, 0] = ax + q * bx + r * cx + d * ux + e * vx + f * wx
        means[n, 1] = ay + q * by + r * cy + d * uy + e * vy + f * wy
        means[n, 2] = az + q * bz + r * cz + d * uz + e * vz + f * wz
        d, e, f = along[n, 0], along[n, 1], along[n, 2]
        quats[n, 0] = behind + d * ux + e * vx + f * wx
        quats[n, 1] = 0
        quats[n, 2] = -(d * uz + e * vz + f * wz)
        quats[n, 3] = d * uy + e * vy + f * wy
