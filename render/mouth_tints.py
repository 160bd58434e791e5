"""Colours inside a mouth, as gains of the stored ones that the prior knows.

A tongue is redder; lower teeth, as bright as the upper ones by the occlusion alone, stand in the
shade of a lip and of those above.
"""

import numpy as np
from numpy.typing import NDArray

from render.types import Floats

TONGUE = np.array([1.0, 0.94, 0.95], np.float32)
LOWER_TEETH = np.array([0.82, 0.85, 0.90], np.float32)


def tint(colors: Floats, tongue: NDArray[np.integer], lower: NDArray[np.integer]) -> None:
    """[V, 3] stored colours of vertices, changed in place; vertices of tongue and lower teeth."""
    colors[tongue] *= TONGUE
    colors[lower] *= LOWER_TEETH
