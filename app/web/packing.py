"""Gaussians to words and words to movers, in one pass each: the layout is that of `cloud.py`.

numba compiles on first use and keeps the result, as for `render/decoder/kernels/surface.py`.
"""

# pyright: reportUntypedFunctionDecorator=false
import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float32]
Words = NDArray[np.uint32]
POSITION_MAX, TURN_MAX, SCALE_MAX = (1 << 14) - 1, (1 << 10) - 1, 255


@njit(cache=True, nogil=True, error_model="numpy")
def level(value: np.float32, largest: np.float32) -> np.uint32:
    """Rounded to a whole number 0..largest; 0 for NaN."""
    if not value > 0:
        return np.uint32(0)
    return np.uint32(min(value, largest) + np.float32(0.5))


@njit(cache=True, nogil=True, error_model="numpy")
def pack_words(
    means: Floats,  # [N, 3] mm
    quats: Floats,  # [N, 4] wxyz
    scales: Floats,  # [N, 3] mm
    opacities: Floats,  # [N]
    colors: Floats,  # [N, 3]
    low_mm: Floats,  # [3]
    steps_per_mm: np.float32,
    low_scale: np.float32,  # log2 of mm
    steps_per_scale: np.float32,  # steps of a doubling
    out: Words,  # -> [N, 4]
) -> None:
    byte, place, turn = np.float32(255), np.float32(POSITION_MAX), np.float32(TURN_MAX)
    half = turn * np.float32(0.5)
    for n in range(len(means)):
        x = level((means[n, 0] - low_mm[0]) * steps_per_mm, place)
        y = level((means[n, 1] - low_mm[1]) * steps_per_mm, place)
        z = level((means[n, 2] - low_mm[2]) * steps_per_mm, place)
        w, i, j, k = quats[n, 0], quats[n, 1], quats[n, 2], quats[n, 3]
        length = np.sqrt(w * w + i * i + j * j + k * k) + np.float32(1e-12)
        share = half / (w + (-length if np.signbit(w) else length))
        a = level(i * share + half, turn)
        b = level(j * share + half, turn)
        c = level(k * share + half, turn)
        sizes, last, last_level = np.uint32(0), np.float32(-1), np.uint32(0)
        for axis in range(3):
            if scales[n, axis] != last:  # most are round in their plane: logarithms are slow
                last = scales[n, axis]
                log = np.log2(max(last, np.float32(1e-4)))
                last_level = level((log - low_scale) * steps_per_scale, np.float32(SCALE_MAX))
            sizes |= last_level << np.uint32(8 * axis)
        shown = level(opacities[n] * byte, byte) << np.uint32(24)
        for channel in range(3):
            shown |= level(colors[n, channel] * byte, byte) << np.uint32(8 * channel)
        out[n, 0] = x | y << np.uint32(14) | (c & np.uint32(15)) << np.uint32(28)
        out[n, 1] = z | a << np.uint32(14) | (b & np.uint32(255)) << np.uint32(24)
        out[n, 2] = sizes | b >> np.uint32(8) << np.uint32(24) | c >> np.uint32(4) << np.uint32(26)
        out[n, 3] = shown


@njit(cache=True, nogil=True)
def find_movers(
    words: Words,  # [N, 4]
    base: Words,  # [N, 4]
    bits: NDArray[np.uint8],  # -> [at least N / 8] one for each mover, lowest first
    out: Words,  # -> [N, 4] the movers' words
) -> int:  # how many
    bits[:] = 0
    count = 0
    for n in range(len(words)):
        same = True
        for k in range(4):
            same &= words[n, k] == base[n, k]
        if not same:
            bits[n >> 3] |= np.uint8(1 << (n & 7))
            for k in range(4):
                out[count, k] = words[n, k]
            count += 1
    return count
