"""Random numbers as a function of a seed and a place, and of nothing else (Philox)."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np

_MASK = 2**64 - 1
_kept = threading.local()


def generator(seed: int, *place: int) -> np.random.Generator:
    """A generator that begins at the counter `place` (4 numbers), to be used at once: there is one
    a thread, because to make one takes ten times as long as to set one."""
    if not hasattr(_kept, "generator"):
        _kept.generator = np.random.Generator(np.random.Philox(key=0))
    state: dict[str, Any] = {
        "bit_generator": "Philox",
        "state": {
            "counter": np.array(place, np.uint64),
            "key": np.array([seed & _MASK, seed >> 64], np.uint64),
        },
        "buffer": np.zeros(4, np.uint64),
        "buffer_pos": 4,  # empty
        "has_uint32": 0,
        "uinteger": 0,
    }
    _kept.generator.bit_generator.state = state
    return _kept.generator
