"""What eye networks see: small left-like pictures of mean 0 and spread 1, by compiled loops."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from encoder.eyes.format import SIDE

MIN_SPREAD = 4.0  # grey levels; a flatter picture is not stretched any further
MOST = 3.0  # spreads from the mean
BRIGHT, ABOVE = 0.97, 0.5  # of the pixels; brighter ones are glints, and cut a little above


def pixels(
    eyes: NDArray[np.uint8],  # [2, 400, 400] left, right; or smaller, by whole steps of 100
) -> NDArray[np.uint8]:  # [2, 100, 100]
    """Small left-like pictures: means of 4 x 4 pixels, the right eye mirrored."""
    small = np.empty((2, SIDE, SIDE), np.uint8)
    _shrink(eyes[0], eyes.shape[1] // SIDE, small[0])
    _shrink(eyes[1], eyes.shape[1] // SIDE, small[1, :, ::-1])
    return small


def normalised(
    small: NDArray[np.uint8],  # [B, n, n]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:  # [B, 1, n, n], [B]
    """Pictures of mean 0 and spread 1, in -3..3: exposure cancels, and glints hardly count. And the
    spreads they had.
    """
    step = small.shape[1] // 25
    some = small[:, ::step, ::step].reshape(len(small), -1)
    half, high = some.shape[1] // 2, int(BRIGHT * (some.shape[1] - 1))
    some = np.partition(some, (half, high), axis=1).astype(np.float32)
    usual, bright = some[:, half], some[:, high]
    limits = bright + np.float32(ABOVE) * (bright - usual)
    stretched = np.empty((len(small), 1, *small.shape[1:]), np.float32)
    spreads = np.empty(len(small), np.float32)
    for b, picture in enumerate(small):
        spreads[b] = _stretch(picture, float(limits[b]), stretched[b, 0])
    return stretched, spreads


@njit(cache=True, nogil=True, error_model="numpy")
def _shrink(picture, shrink, small):  # type: ignore[no-untyped-def]
    """[n * shrink, n * shrink] -> [n, n] means, rounded."""
    area = np.uint32(shrink * shrink)
    share = np.uint32(2**20) // area + np.uint32(1)  # a product costs less than a division
    tall = np.empty(picture.shape[1], np.uint16)  # sums of `shrink` rows
    for row in range(small.shape[0]):
        tall[:] = 0
        for i in range(shrink):
            for column in range(len(tall)):
                tall[column] += picture[row * shrink + i, column]
        for column in range(small.shape[1]):
            total = area // 2
            for j in range(shrink):
                total += tall[column * shrink + j]
            small[row, column] = (total * share) >> np.uint32(20)


@njit(cache=True, nogil=True, error_model="numpy")
def _stretch(picture, limit, out):  # type: ignore[no-untyped-def]
    """A picture [n, n] into `out`; its spread. Worked out for each of the 256 grey levels."""
    counts = np.zeros(256, np.int64)
    for row in range(picture.shape[0]):
        for column in range(picture.shape[1]):
            counts[picture[row, column]] += 1
    total = squares = 0.0
    for level in range(256):
        value = min(float(level), limit)
        total += counts[level] * value
        squares += counts[level] * value * value
    mean = total / picture.size
    spread = np.sqrt(max(squares / picture.size - mean * mean, 0.0))
    shown = np.empty(256, np.float32)
    for level in range(256):
        value = (min(float(level), limit) - mean) / max(spread, MIN_SPREAD)
        shown[level] = min(max(value, -MOST), MOST)
    for row in range(picture.shape[0]):
        for column in range(picture.shape[1]):
            out[row, column] = shown[picture[row, column]]
    return spread
