"""A mouth of two vertices: contacts without the decoder."""

import numpy as np

from encoder.capture.motion.channels import JAW_OPEN, MOUTH_CLOSE, RIG_NAMES
from encoder.capture.motion.contacts import SLOPE_MM, LipGeometry


def lip_geometry() -> LipGeometry:
    """A mouth that jawOpen opens by 29 mm and mouthClose closes; one vertex on each lip."""
    basis = np.zeros((2, len(RIG_NAMES)), np.float32)
    basis[1, JAW_OPEN], basis[1, MOUTH_CLOSE] = -29.0, SLOPE_MM
    one = [np.array([0])], [np.array([1])]
    return LipGeometry(np.zeros((1, 2), np.float32), basis, *one, np.arange(2))
