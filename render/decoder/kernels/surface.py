"""Loops of the decoder: one pass over memory where numpy takes many.

numba compiles them on first use (seconds, once a machine) and keeps the result beside this file.
All add in a fixed order, and those that threads share make each Gaussian alone: the same input
gives the same bits.
Cross products and rotations are written out in each loop, as plain scalars of one pass.
"""

# pyright: reportUntypedFunctionDecorator=false
import numpy as np

from render.decoder.kernels.vectors import LANES, loop, place_gaussian
from render.types import Floats, Ints, Shorts

# Numbers that a vertex hands on, each kind from the start of a quarter of a vector: place, mm;
# three of a turn's wxyz; light; shares of key and sky. The others are zeros.
CARRIED = LANES
PLACE, TURN, LIGHT, SHARES = 0, 4, 8, 12
BLOCK = 128  # vertices, and Gaussians, that are made together: a loop of vectors for each number


@loop
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


@loop
def normalise(
    totals: Floats,  # [n + 1, 4] see around_vertices
    rows: Ints,  # [n] of `normals`
    normals: Floats,  # -> [N, 3] unit, these rows
) -> None:
    for n in range(len(rows)):
        row = np.uintp(rows[n])
        x, y, z = totals[n, 0], totals[n, 1], totals[n, 2]
        length = np.sqrt(x * x + y * y + z * z + np.float32(1e-12))
        for k in range(3):
            normals[row, k] = totals[n, k] / length


@loop
def stretches(
    areas: Floats,  # [F + 1] mm^2 -> factors of widths, in place
    rest_areas: Floats,  # [F + 1] mm^2, of the mean face
    low: np.float32,
    high: np.float32,
) -> None:
    for f in range(len(areas)):
        areas[f] = min(max(np.sqrt(areas[f] / rest_areas[f]), low), high)


@loop
def skin_gaussians(
    first: int,  # Gaussian, a multiple of BLOCK: the same Gaussians are the same to the bit
    last: int,  # left out
    attributes: Floats,  # [U, CARRIED]
    rows: Shorts,  # [N, 3] vertices of the anchors' triangles
    weights: Floats,  # [N, 3] barycentric coordinates
    stretches: Floats,  # [F + 1] of the triangles
    triangles: Shorts,  # [N] which of them an anchor's width follows
    widths: Floats,  # [N] mm, not stretched
    reflected: Floats,  # [N, 3] linear albedo
    gloss: Floats,  # [N] weight of mirrored light
    depths: Floats,  # [N] mm under the skin
    film: Floats,  # [5] see lighting.FILM, with the exposure
    flatness: np.float32,
    behind: np.float32,  # see surface.normals_of
    means: Floats,  # -> [N, 3] mm
    quats: Floats,  # -> [N, 4]
    scales: Floats,  # -> [N, 3] mm
    colors: Floats,  # -> [N, 3] stored, 0..1, without mirrored light
    shine: Floats,  # -> [N, 2] of 4: weight of the mirrored light of the key light and the fill
) -> None:
    stored = colors.reshape(-1)
    for start in range(first, last, BLOCK):
        count = min(BLOCK, last - start)
        for i in range(count):
            n = np.uintp(start + i)
            a, b, c = np.uintp(rows[n, 0]), np.uintp(rows[n, 1]), np.uintp(rows[n, 2])
            u, v, t = weights[n, 0], weights[n, 1], weights[n, 2]
            place_gaussian(  # pyright: ignore[reportCallIssue]
                attributes, a, b, c, u, v, t, depths[n], behind, reflected, gloss[n],
                means, quats, colors, shine, n,
            )  # fmt: skip
        develop(stored[3 * start : 3 * (start + count)], film)
        for i in range(count):
            n = np.uintp(start + i)
            width = widths[n] * stretches[np.uintp(triangles[n])]
            scales[n, 0], scales[n, 1], scales[n, 2] = width, width, width * flatness


@loop
def develop(values: Floats, film: Floats) -> None:  # [n] linear -> stored, in place; [5]
    zero, one = np.float32(0), np.float32(1)
    a, b, c, d, e = film[0], film[1], film[2], film[3], film[4]
    for i in range(len(values)):
        x = max(values[i], zero)
        values[i] = np.sqrt(min(x * (a * x + b) / (x * (c * x + d) + e), one))


@loop
def scaled(values: Floats, rows: Ints, by: np.float32, out: Floats) -> None:
    """[N], [n] -> [N], these rows."""
    for row in rows:
        out[np.uintp(row)] = by * values[np.uintp(row)]


@loop
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
