"""BlockRing: sound from the audio callback to the polling thread, without locks or allocation.

One writer (PortAudio's thread) and one reader; each index has a single owner, so a slot is only
read after it is whole. A full ring drops the new block and counts it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class SoundBlock:
    """One callback's worth of sound."""

    first_sample: int  # counter since the stream started, dropped blocks included
    arrival_ns: int  # when the callback ran
    samples: NDArray[np.float32]  # [n, channels], a copy
    overflow: bool  # the driver says that it lost sound before this block


class BlockRing:
    """Preallocated slots of at most `block_size` samples."""

    def __init__(self, num_blocks: int, block_size: int, channels: int) -> None:
        self.dropped_samples = 0
        self._samples = np.zeros((num_blocks, block_size, channels), np.float32)
        self._first = np.zeros(num_blocks, np.int64)
        self._length = np.zeros(num_blocks, np.int64)
        self._arrival_ns = np.zeros(num_blocks, np.int64)
        self._overflow = np.zeros(num_blocks, np.bool_)
        self._counter = 0
        self._written = 0  # blocks; owned by the writer
        self._read = 0  # blocks; owned by the reader

    def write(
        self,
        samples: NDArray[np.float32],  # [n, channels]
        arrival_ns: int,
        overflow: bool,
    ) -> None:
        num = len(samples)
        if self._written - self._read == len(self._samples):
            self.dropped_samples += num
            self._counter += num
            return
        slot = self._written % len(self._samples)
        self._samples[slot, :num] = samples
        self._first[slot], self._length[slot] = self._counter, num
        self._arrival_ns[slot], self._overflow[slot] = arrival_ns, overflow
        self._counter += num
        self._written += 1

    def read(self) -> list[SoundBlock]:
        """Every whole block that has not been read yet, oldest first."""
        blocks: list[SoundBlock] = []
        while self._read < self._written:
            slot = self._read % len(self._samples)
            samples = self._samples[slot, : self._length[slot]].copy()
            first, arrival = int(self._first[slot]), int(self._arrival_ns[slot])
            blocks.append(SoundBlock(first, arrival, samples, bool(self._overflow[slot])))
            self._read += 1
        return blocks
