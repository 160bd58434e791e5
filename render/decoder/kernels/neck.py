"""Loops of the neck, compiled by numba and written out as those of `surface.py` are."""

# pyright: reportUntypedFunctionDecorator=false
import numpy as np
from numpy.typing import NDArray

from render.decoder.kernels.vectors import loop
from render.types import Floats, Ints


@loop
def spine(
    rest: NDArray[np.float64],  # [K, 3] mm, from its base to the head's joint
    angle: float,  # rad that the head turns ...
    axis: tuple[float, float, float],  # ... about this one, unit
    position: tuple[float, float, float],  # mm that it is pushed
    breath: float,  # 0..1
    lift: tuple[float, float, float],  # mm of the chest in a full breath
    turns: Floats,  # -> [K, 4] wxyz at each step
    moves: Floats,  # -> [K, 3, 4] the same with the way of a point there
    from_head: Floats,  # -> [K, 3, 4] seen from the head, as if it rested
) -> None:
    """Every step turns by the same part; the next begins where the last one ends."""
    last = len(rest) - 1
    matrix, place, exact = np.empty((3, 3)), rest[0].copy(), np.empty((len(rest), 3, 4))
    for n in range(len(rest)):
        way = n / last
        w, sine = np.cos(0.5 * angle * way), np.sin(0.5 * angle * way)
        x, y, z = sine * axis[0], sine * axis[1], sine * axis[2]
        turns[n, 0], turns[n, 1], turns[n, 2], turns[n, 3] = w, x, y, z
        matrix[0, 0], matrix[0, 1] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z)
        matrix[0, 2], matrix[1, 0] = 2 * (x * z + w * y), 2 * (x * y + w * z)
        matrix[1, 1], matrix[1, 2] = 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
        matrix[2, 0], matrix[2, 1] = 2 * (x * z - w * y), 2 * (y * z + w * x)
        matrix[2, 2] = 1 - 2 * (x * x + y * y)
        for k in range(3):
            pushed = way * position[k] + breath * (1 - way) * lift[k]
            exact[n, k, 3] = place[k] + pushed
            for j in range(3):
                exact[n, k, j] = matrix[k, j]
                exact[n, k, 3] -= matrix[k, j] * rest[n, j]
                place[k] += matrix[k, j] * (rest[1, j] - rest[0, j])
    for n in range(len(rest)):
        for k in range(3):
            for j in range(4):
                moves[n, k, j] = exact[n, k, j]
                seen = 0.0
                for i in range(3):
                    off = exact[last, i, 3] if j == 3 else 0.0
                    seen += exact[last, i, k] * (exact[n, i, j] - off)
                from_head[n, k, j] = seen


@loop
def bend(
    rows: Ints,  # [n] which points
    along: Floats,  # [n] how far they go with the head: 0 shoulders .. 1 head
    moves: Floats,  # [K, 3, 4] at even steps of that
    points: Floats,  # [N, 3] mm
    out: Floats,  # -> [N, 3] these rows; may be `points`
) -> None:
    last = len(moves) - 1
    for n in range(len(rows)):
        at = along[n] * np.float32(last)
        low = np.uintp(min(np.intp(at), last - 1))
        high = np.uintp(low + np.uintp(1))
        v = at - np.float32(low)
        u = np.float32(1) - v
        row = np.uintp(rows[n])
        x, y, z = points[row, 0], points[row, 1], points[row, 2]
        for k in range(3):
            a = u * moves[low, k, 0] + v * moves[high, k, 0]
            b = u * moves[low, k, 1] + v * moves[high, k, 1]
            c = u * moves[low, k, 2] + v * moves[high, k, 2]
            d = u * moves[low, k, 3] + v * moves[high, k, 3]
            out[row, k] = a * x + b * y + c * z + d


@loop
def turn_normals(
    rows: Ints,  # [n] which normals
    along: Floats,  # [n] see bend
    moves: Floats,  # [K, 3, 4]
    normals: Floats,  # [N, 3] unit
    out: Floats,  # -> [N, 3] these rows, at the nearest step
) -> None:
    last = len(moves) - 1
    for n in range(len(rows)):
        i = np.uintp(along[n] * np.float32(last) + np.float32(0.5))
        row = np.uintp(rows[n])
        x, y, z = normals[row, 0], normals[row, 1], normals[row, 2]
        for k in range(3):
            out[row, k] = moves[i, k, 0] * x + moves[i, k, 1] * y + moves[i, k, 2] * z


@loop
def turn_quats(
    rows: Ints,  # [n] which rotations
    along: Floats,  # [n] see bend
    turns: Floats,  # [K, 4] wxyz
    quats: Floats,  # [N, 4]
    out: Floats,  # -> [N, 4] these rows, at the nearest step
) -> None:
    last = len(turns) - 1
    for n in range(len(rows)):
        i = np.uintp(along[n] * np.float32(last) + np.float32(0.5))
        row = np.uintp(rows[n])
        p, q, r, s = turns[i, 0], turns[i, 1], turns[i, 2], turns[i, 3]
        w, x, y, z = quats[row, 0], quats[row, 1], quats[row, 2], quats[row, 3]
        out[row, 0] = p * w - q * x - r * y - s * z
        out[row, 1] = p * x + q * w + r * z - s * y
        out[row, 2] = p * y - q * z + r * w + s * x
        out[row, 3] = p * z + q * y - r * x + s * w


@loop
def turn(
    move: Floats,  # [3, 4]
    quat: Floats,  # [4] wxyz, the same as a rotation
    means: Floats,  # [N, 3] mm
    quats: Floats,  # [N, 4]
    out_means: Floats,  # -> [N, 3]; may be `means`
    out_quats: Floats,  # -> [N, 4]; may be `quats`
) -> None:
    a, b, c, d = move[0, 0], move[0, 1], move[0, 2], move[0, 3]
    e, f, g, h = move[1, 0], move[1, 1], move[1, 2], move[1, 3]
    i, j, k, m = move[2, 0], move[2, 1], move[2, 2], move[2, 3]
    p, q, r, s = quat[0], quat[1], quat[2], quat[3]
    for n in range(len(means)):
        x, y, z = means[n, 0], means[n, 1], means[n, 2]
        out_means[n, 0] = a * x + b * y + c * z + d
        out_means[n, 1] = e * x + f * y + g * z + h
        out_means[n, 2] = i * x + j * y + k * z + m
    for n in range(len(quats)):
        w, x, y, z = quats[n, 0], quats[n, 1], quats[n, 2], quats[n, 3]
        out_quats[n, 0] = p * w - q * x - r * y - s * z
        out_quats[n, 1] = p * x + q * w + r * z - s * y
        out_quats[n, 2] = p * y - q * z + r * w + s * x
        out_quats[n, 3] = p * z + q * y - r * x + s * w


@loop
def widen(
    rows: Ints,  # [n] which Gaussians
    stretch: Floats,  # [n] a rad
    angle: np.float32,  # rad
    widths: Floats,  # [N] mm, changed in place
) -> None:
    for n in range(len(rows)):
        widths[rows[n]] *= np.float32(1) + stretch[n] * angle
