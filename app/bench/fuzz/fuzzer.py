"""Damages bytes, and texts inside them; what every target of `bench fuzz` is fed with."""

import re

import numpy as np
from numpy.typing import NDArray

TRICKS = 7
WORD = re.compile(rb"[0-9.]+|[A-Za-z_]+")
ODD = (
    b"-1", b"0", b"1e999", b"-1e-999", b"NaN", b"-Infinity", b"9" * 5000, b"1" + b"0" * 30,
    b"null", b"true", b'""', b"[" * 3000, b'{"a":1}', b"\xff\xfe", b"\x00", b"\x1b[31m",
    b"[/boom]", b"../..",    b"4294967296", b"18446744073709551615", b"\n", b" ", b",,",
)  # fmt: skip


class Fuzzer:
    """Mutates bytes; equal seeds make equal bytes."""

    def __init__(self, *seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        self.last = b""  # what `mutate` made last

    def pick(self, count: int) -> int:
        """A number below `count`."""
        return int(self.rng.integers(count))

    def mutate(self, data: bytes) -> bytes:
        """One to four tricks."""
        out = bytearray(data)
        for _ in range(1 + self.pick(4)):
            self._trick(out)
        self.last = bytes(out)
        return self.last

    def pieces(self, data: bytes) -> list[bytes]:
        """The same bytes in up to six reads."""
        edges = sorted(int(e) for e in self.rng.integers(0, len(data) + 1, self.pick(6)))
        return [data[a:b] for a, b in zip([0, *edges], [*edges, len(data)], strict=True)]

    def array(self, values: NDArray[np.generic]) -> NDArray[np.generic]:
        """Another array in its place: its bytes damaged, cut, of another shape or type."""
        kind, flat = self.pick(4), np.ascontiguousarray(values).reshape(-1)
        if kind == 0 and flat.size:
            damaged = bytearray(flat.tobytes())
            for at in self.rng.integers(len(damaged), size=8):
                damaged[at] = self.pick(256)
            return np.frombuffer(bytes(damaged), flat.dtype).reshape(values.shape)
        if kind == 1:
            return flat[: self.pick(flat.size + 1)]
        if kind == 2:
            return values[..., None]
        return values.astype(("float32", "int8", "uint8", "int32", "float64")[self.pick(5)])

    def _trick(self, out: bytearray) -> None:
        rng, size = self.rng, max(len(out), 1)
        at, num = self.pick(size), 1 + self.pick(max(size // 4 - 1, 1))
        kind = self.pick(TRICKS)
        if kind == 0:
            for k in rng.integers(size, size=8):
                out[k : k + 1] = rng.bytes(1)
        elif kind == 1:
            del out[at : at + num]
        elif kind == 2:
            out[at:at] = out[at : at + num]
        elif kind == 3:
            out[at : at + 4] = int(rng.choice([0, 1, 2**31, 2**32 - 1])).to_bytes(4, "little")
        elif kind == 4:
            out[at:at] = rng.bytes(num)
        elif kind == 5:
            out[at : at + num] = bytes(num)
        elif word := WORD.search(out, at):
            out[word.start() : word.end()] = ODD[self.pick(len(ODD))]
