"""pi, the mixture of K Gaussians from which the student's tau is drawn (paper appendix).

After Chadebec et al. 2024: four updates move its weights beta from four steps to tau = N alone.
"""

import numpy as np

NUM_MODES = 40  # K: Gaussians in pi, one a DDIM step of the paper
SPREAD = 0.5**0.5 / NUM_MODES**2
# beta of the modes at tau / N = 0.25, 0.5, 0.75, 1; all others have none
_PHASES = (
    (0.25, 0.25, 0.25, 0.25),
    (0.2, 0.2, 0.25, 0.35),
    (0.1, 0.15, 0.25, 0.5),
    (0.0, 0.05, 0.15, 0.8),
    (0.0, 0.0, 0.0, 1.0),
)
LAST_PHASE = len(_PHASES) - 1


def beta(phase: int) -> np.ndarray:
    """[K] weights of the Gaussians with means i / K, i = 1..K, after `phase` of four updates."""
    weights = np.zeros(NUM_MODES)
    quarter = NUM_MODES // 4
    weights[quarter - 1 :: quarter] = _PHASES[phase]
    return weights


def draw_tau(phase: int, num_steps: int, rng: np.random.Generator) -> int:
    """One tau from pi."""
    mean = (rng.choice(NUM_MODES, p=beta(phase)) + 1) / NUM_MODES
    return int(np.clip(round(rng.normal(mean, SPREAD) * num_steps), 1, num_steps))
