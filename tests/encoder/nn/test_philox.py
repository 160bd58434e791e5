"""One Philox generator a thread draws what new ones draw."""

import numpy as np
import pytest

from encoder.nn import philox


@pytest.mark.parametrize("seed", [0, 5, 2**63 + 7, 2**100 + 3])
def test_a_kept_generator_is_a_new_one(seed: int) -> None:
    for place in ((0, 0, 0, 0), (30, 0, 5, 12345), (1, 0, 2, 2**40)):
        for draw in ("standard_normal", "random"):
            new = np.random.Generator(np.random.Philox(key=seed, counter=list(place)))
            kept = philox.generator(seed, *place)
            kept.integers(10, size=3, dtype=np.int32)  # leaves half a number behind
            kept = philox.generator(seed, *place)
            expected = getattr(new, draw)(7, dtype=np.float32)
            assert np.array_equal(getattr(kept, draw)(7, dtype=np.float32), expected)
