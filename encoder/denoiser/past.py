"""The denoiser's memory of a live stream: keys and values of the last w frames.

A `Past` is a value like every state, but no tick copies its 200 KB. The ring that the network
reads is written in place, and each frame's row (8 KB) is also appended to a log, in blocks of w
frames. The ring belongs to the newest state of its stream; an older one, or a second future of the
same one, makes a ring of its own from the log.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from encoder.types import Floats


@dataclass(eq=False)
class KeyValueRing:
    """What the network reads; frame t lies in slot t % w."""

    keys: Floats  # [L, H, w, D] rotated
    values: Floats  # [L, H, w, D]
    frame: int  # of the state that it belongs to


@dataclass(frozen=True, eq=False)
class Past:
    """Frames before `frame`; slots of frames before the stream began hold zeros."""

    frame: int
    ring: KeyValueRing
    last: Floats  # [w, 2, L, H, D] log of the block before the current one; complete
    current: Floats  # [w, 2, L, H, D] log of the current block, filled up to slot frame % w

    @staticmethod
    def empty(layers: int, heads: int, window: int, head_dim: int) -> Past:
        shape = (layers, heads, window, head_dim)
        ring = KeyValueRing(np.zeros(shape, np.float32), np.zeros(shape, np.float32), 0)
        block = (window, 2, layers, heads, head_dim)
        return Past(0, ring, np.zeros(block, np.float32), np.zeros(block, np.float32))

    def owned(self) -> Past:
        """This past while it owns its ring; otherwise a copy with a ring of its own."""
        if self.ring.frame == self.frame:
            return self
        slot = self.frame % len(self.last)
        current = self.current.copy()  # another future may write the next row
        rows = np.concatenate([current[:slot], self.last[slot:]])
        keys, values = np.ascontiguousarray(rows.transpose(1, 2, 3, 0, 4))
        return Past(self.frame, KeyValueRing(keys, values, self.frame), self.last, current)

    def followed_by(self, key: Floats, value: Floats) -> Past:
        """The past of the next frame, from an owned one; key, value [L, H, D] of this frame."""
        ring, window = self.ring, len(self.last)
        slot = self.frame % window
        ring.keys[:, :, slot], ring.values[:, :, slot] = key, value
        ring.frame = self.frame + 1
        self.current[slot] = key, value
        last, current = self.last, self.current
        if slot == window - 1:
            last, current = current, np.zeros_like(current)
        return Past(self.frame + 1, ring, last, current)
