"""Loops of the neck, compiled by numba as those of `surface.py` are."""

# pyright: reportUntypedFunctionDecorator=false
import numpy as np
from numba import njit
from numpy.typing import NDArray

from render.types import Floats, Ints


@njit(cache=True, nogil=True, error_model="numpy")
def matrices(
    quats: NDArray[np.float64],  # [n, 4] wxyz, unit
    out: NDArray[np.float64],  # -> [n, 3, 3]
) -> None:
    for n in range(len(quats)):
        w, x, y, z = quats[n, 0], quats[n, 1], quats[n, 2], quats[n, 3]
        out[n, 0, 0] = 1 - 2 * (y * y + z * z)
        out[n, 0, 1] = 2 * (x * y - w * z)
        out[n, 0, 2] = 2 * (x * z + w * y)
        out[n, 1, 0] = 2 * (x * y + w * z)
        out[n, 1, 1] = 1 - 2 * (x * x + z * z)
        out[n, 1, 2] = 2 * (y * z - w * x)
        out[n, 2, 0] = 2 * (x * z - w * y)
        out[n, 2, 1] = 2 * (y * z + w * x)
        out[n, 2, 2] = 1 - 2 * (x * x + y * y)


@njit(cache=True, nogil=True, error_model="numpy")
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


@njit(cache=True, nogil=True, error_model="numpy")
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


@njit(cache=True, nogil=True, error_model="numpy")
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


@njit(cache=True, nogil=True, error_model="numpy")
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
