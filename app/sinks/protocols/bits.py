"""A face parameter as bools, as avatars take it that save synced memory: JawOpen1, JawOpen2,
JawOpen4, ... are the bits of its size, JawOpenNegative is its sign.

    names that an avatar has -> bits_among -> Bits a parameter -> BitEncoder -> bools of a tick

The sizes are VRCFaceTracking's (BinaryBaseParameter.cs), which avatars are made for: 0..1 falls
into 2^n equal steps, and 1 is in the last of them.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

MAX_BITS = 8  # VRChat's own synced floats have no more
NEGATIVE = "Negative"


@dataclass(frozen=True)
class Bits:
    """How an avatar takes one parameter."""

    num: int  # 1..MAX_BITS
    negative: bool  # has a bool for the sign; without one, what is below 0 counts as 0

    @property
    def suffixes(self) -> list[str]:
        return [str(1 << k) for k in range(self.num)] + [NEGATIVE] * self.negative


def bits_among(there: Collection[str], names: Iterable[str]) -> dict[str, Bits]:
    """Those of `names` that are there as bits. One with a gap, or with more than MAX_BITS, is not:
    nobody knows what its bits stand for."""
    found: dict[str, Bits] = {}
    for name in names:
        has = [f"{name}{1 << k}" in there for k in range(MAX_BITS + 1)]
        num = sum(has)
        if 0 < num <= MAX_BITS and all(has[:num]):
            found[name] = Bits(num, name + NEGATIVE in there)
    return found


class BitEncoder:
    """The bools of those parameters that an avatar has as bits, one parameter after another."""

    def __init__(self, names: Sequence[str], bits: Mapping[str, Bits]) -> None:
        taken = [(row, name, bits[name]) for row, name in enumerate(names) if name in bits]
        self.names = [name + suffix for _, name, b in taken for suffix in b.suffixes]
        self._rows = np.array([row for row, _, _ in taken], np.intp)
        self._steps = np.array([1 << b.num for _, _, b in taken], np.int64)
        self._lowest = np.array([-float(b.negative) for _, _, b in taken])
        places = [(k, j) for k, (_, _, b) in enumerate(taken) for j in range(len(b.suffixes))]
        self._owners, self._shifts = np.array(places, np.int64).reshape(-1, 2).T

    def __call__(
        self,
        values: NDArray[np.float32],  # [parameters] in the order of the names
    ) -> NDArray[np.bool_]:  # [bools] in the order of `self.names`
        mine = values[self._rows].clip(self._lowest, 1.0)
        codes = np.minimum(np.abs(mine) * self._steps, self._steps - 1).astype(np.int64)
        codes += (mine < 0) * self._steps  # the sign is the bit after the others
        return (codes[self._owners] >> self._shifts & 1).astype(np.bool_)
