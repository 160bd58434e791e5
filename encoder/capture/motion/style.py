"""How one subject moves, drawn anew for every subject that the capture makes."""

from dataclasses import dataclass, field

import numpy as np

from encoder.capture.motion.gestures import GESTURES
from encoder.capture.speech.phones import PHONES


@dataclass(frozen=True)
class Style:
    """How one subject moves; without it a diffusion model would have nothing to learn."""

    jaw: float = 1.0
    lips: float = 1.0
    spread: float = 1.0
    lead_s: float = 0.05
    lag_s: float = 0.055
    loud: float = 0.65  # how far the jaw follows loudness
    smile: float = 0.0
    skew: float = 0.0  # left against right
    sideways: float = 0.0  # the jaw drifts to one side as it opens
    press: float = 0.22
    jitter_s: float = 0.0  # timing noise of each phone
    brows: float = 1.0
    blinks: float = 1.0
    idiolect: np.ndarray = field(default_factory=lambda: np.ones((len(PHONES), len(GESTURES))))

    @staticmethod
    def draw(rng: np.random.Generator) -> "Style":
        ranges = (
            (0.7, 1.25), (0.7, 1.3), (0.5, 1.4), (0.04, 0.058), (0.045, 0.07), (0.5, 0.8),
            (-0.08, 0.1), (-0.12, 0.12), (-0.12, 0.12), (0.1, 0.35), (0.002, 0.009), (0.4, 1.6),
            (0.85, 1.1),
        )  # fmt: skip
        low, high = np.array(ranges).T
        values = [float(v) for v in rng.uniform(low, high)]
        values[6] = max(values[6], 0.0)
        own = np.exp(0.14 * rng.standard_normal((len(PHONES), len(GESTURES))))
        return Style(*values, idiolect=own)
