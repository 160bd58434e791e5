"""L_geom: velocity and jitter of face vertices (paper section 4.1.2); the lips' spread and contact.

The frozen decoder comes from the app as a `TrainingFace`; nothing here knows render.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

NEAR_MM = 1.0  # gap of the inner lips at which they are nearly shut
NEAR_FRAMES = 2  # by which a closure may be early or late
SHUT_WEIGHT = 1.0  # of a missed closure, on top of the 1 of a false one
REST_FRAMES = 7  # shut for so long before and after: not speaking
REST_WEIGHT = 0.3  # per mm
JITTER_FLOOR_MM = 0.5  # per frame^3; a jaw that swings 5 mm at 2 Hz has 0.5


@dataclass(frozen=True)
class TrainingFace:
    """The parts of the frozen decoder that training needs, as callables."""

    rig_to_code: Callable[[np.ndarray], np.ndarray]  # [..., 53], with tongue 55 -> [..., 256]
    vertices: Callable[[Tensor], Tensor]  # codes [B, T, 256] -> [B, T, V, 3] mm
    weights: Tensor  # [V], mean 1: w_i of the paper, larger for the mouth
    gaps: Callable[[Tensor], Tensor]  # codes [B, T, 256] -> [B, T, P, 3] mm between the inner lips
    spans: Callable[[Tensor], Tensor]  # codes [B, T, 256] -> [B, T, 2] mm, corners and centres
    mouth: Callable[[Tensor], Tensor]  # codes [B, T, 256] -> their part that moves mouth and tongue
    tongue: Callable[[Tensor], Tensor]  # codes [..., 256] -> [..., 2] tip and back raised, 0..1


def velocity_loss(predicted: Tensor, truth: Tensor, weights: Tensor) -> Tensor:
    """Vertices [B, T, V, 3] mm -> weighted mean squared error of frame-to-frame motion, mm^2."""
    error = (predicted - truth).diff(dim=1).square().sum(-1)
    return (error * weights.to(error)).mean()


def jitter(vertices: Tensor) -> Tensor:  # [B, T, V, 3] -> [B, T - 3, V, 3]
    """v_t - 3 v_(t-1) + 3 v_(t-2) - v_(t-3), mm a frame^3."""
    return vertices.diff(dim=1, n=3)


def jitter_loss(
    predicted: Tensor,  # [B, T, V, 3] mm
    truth: Tensor,  # [B, T, V, 3] mm
    weights: Tensor,  # [V]
    *,
    normalised: bool = True,
    floor: float = JITTER_FLOOR_MM,
) -> Tensor:
    """The paper's |j / j_gt - 1|^2 with j_gt kept from zero, mean over frames, vertices and axes.

    j_gt passes through zero, so the divisor is d = sign(j_gt) max(|j_gt|, floor), sign(0) = 1. The
    loss is ((j - j_gt) / d)^2: the paper's where |j_gt| >= floor; below, a squared difference in
    units of the floor. (Dividing j itself by d would move the minimum from j_gt to d.) Its gradient
    in j is 2 (j - j_gt) / d^2: never larger than 2 |j - j_gt| / floor^2, zero only at the truth.
    Not normalised (an ablation of the paper): (j - j_gt)^2.
    """
    target = jitter(truth)
    error = jitter(predicted) - target
    if normalised:
        sign = torch.where(target < 0, -1.0, 1.0)
        error = error / (sign * target.abs().clamp(min=floor))
    return (error.square().mean(-1) * weights.to(error)).mean()


def spread_loss(predicted: Tensor, truth: Tensor, weights: Tensor) -> Tensor:
    """Vertices [B, T, V, 3] mm -> error of each vertex's spread over the clip, mm^2 (not in the
    paper).

    A squared error alone makes a mouth move too little, as far as it is certain; this loss makes it
    move as far as the truth does, and not at all where the truth rests.
    """
    spreads = [(v.var(dim=1, correction=0).sum(-1) + 1e-4).sqrt() for v in (predicted, truth)]
    return ((spreads[0] - spreads[1]).square() * weights.to(predicted)).mean()


def closeness(gaps: Tensor) -> Tensor:  # [B, T, P, 3] mm -> [B, T]
    """1 where lips touch, 0 where they are wide open."""
    return torch.exp(-gaps[..., 1].mean(-1).abs() / NEAR_MM)


def closest(gaps: Tensor) -> Tensor:  # [B, T, P, 3] mm -> [B, T]
    """The largest closeness within NEAR_FRAMES."""
    return functional.max_pool1d(closeness(gaps), 2 * NEAR_FRAMES + 1, 1, NEAR_FRAMES)


def contact_loss(predicted: Tensor, truth: Tensor) -> Tensor:
    """Gaps of the inner lips [B, T, P, 3] mm -> how far closures are missed, 0..1 (not in the
    paper).

    A squared error of the codes leaves lips half open wherever a closure is likely, since its time
    is never certain. So the largest closeness within NEAR_FRAMES is compared: a closure two frames
    late counts. Lips that are open in both are left alone, and so is the mean opening. (A distance
    of the gaps, nine times heavier where they are shut, made free speech open by 3.4 mm instead of
    5.4.) For lips at rest it is an absolute distance, since under a squared one they drift.
    """
    shut, wanted = closest(predicted), closest(truth)
    missed = (shut - wanted).square() * (1 + SHUT_WEIGHT * wanted)
    near = closeness(truth)
    resting = -functional.max_pool1d(-near, 2 * REST_FRAMES + 1, 1, REST_FRAMES) > 0.5
    distance = ((predicted - truth).square().sum(-1) + 1e-4).sqrt() - 1e-2
    wandered = distance.mean(-1) * resting
    return missed.mean() + REST_WEIGHT * wandered.mean()
