"""Rows of small whole numbers as few bits: one row in full, its predecessors as differences.

A difference is written in groups of eleven fields, each group with the width that it needs, so that
a face that hardly moved costs half of one in full, and nothing is lost.
"""

import numpy as np
from numpy.typing import NDArray

GROUP = 11  # fields
WIDTH_BITS = 4
Ints = NDArray[np.int64]
Bits = NDArray[np.uint8]  # of 0 and 1, highest first

_SHIFTS = np.arange(16)[::-1]  # a field has 16 bits at most


class BitsError(ValueError):
    """Malformed bits."""


def full(values: Ints, widths: Ints) -> Bits:
    """`values` [F] in 0 .. 2**width - 1."""
    return (values[:, None] >> _SHIFTS & 1).astype(np.uint8)[_used(widths)]


def difference(values: Ints, later: Ints) -> Bits:
    """`values` [F] as what is to be added to `later` [F]."""
    step = np.zeros((-(-len(values) // GROUP), GROUP), np.int64)
    step.reshape(-1)[: len(values)] = values - later
    width = np.frexp(np.abs(step).max(1))[1].astype(np.int64)[:, None]  # [G, 1] bits
    width += width > 0  # and a sign
    step += 1 << width >> 1
    used = np.zeros((*step.shape, len(_SHIFTS)), bool)
    used[:] = width[:, :, None] > _SHIFTS
    used.reshape(-1, len(_SHIFTS))[len(values) :] = False
    rows = np.concatenate([width, step], 1)[:, :, None] >> _SHIFTS & 1  # [G, 1 + GROUP, 16]
    head = np.broadcast_to(_SHIFTS < WIDTH_BITS, (len(step), 1, len(_SHIFTS)))
    return rows[np.concatenate([head, used], 1)].astype(np.uint8)


class Reader:
    """Reads what `full` and `difference` wrote, in order."""

    def __init__(self, data: bytes) -> None:
        self._bits = np.unpackbits(np.frombuffer(data, np.uint8))
        self._at = 0

    def full(self, widths: Ints) -> Ints:
        """[F]"""
        bits = np.zeros((len(widths), len(_SHIFTS)), np.int64)
        size = int(widths.sum())
        taken = self._bits[self._at : self._at + size]
        if len(taken) < size:
            raise BitsError("expected more bits, got the end")
        bits[_used(widths)] = taken
        self._at += size
        return bits @ (1 << _SHIFTS)

    def difference(self, later: Ints, widths: Ints) -> Ints:
        """[F]; BitsError where a value leaves its field."""
        values = later.copy()
        for start in range(0, len(later), GROUP):
            width = int(self._take(1, WIDTH_BITS)[0])
            count = min(GROUP, len(later) - start)
            values[start : start + GROUP] += self._take(count, width) - (1 << width >> 1)
        if (values < 0).any() or (values >= 1 << widths).any():
            raise BitsError("differences: expected values within their fields")
        return values

    def end(self) -> None:
        """Raise BitsError unless only the zeros that fill the last byte are left."""
        rest = self._bits[self._at :]
        if len(rest) >= 8 or rest.any():
            raise BitsError(f"expected the end, got {len(rest)} bits more")

    def _take(self, count: int, width: int) -> Ints:
        size = count * width
        taken = self._bits[self._at : self._at + size]
        if len(taken) < size:
            raise BitsError("expected more bits, got the end")
        self._at += size
        return taken.reshape(count, width).astype(np.int64) @ (1 << np.arange(width)[::-1])


def _used(widths: Ints) -> NDArray[np.bool_]:  # [F, 16]
    return widths[:, None] > _SHIFTS
