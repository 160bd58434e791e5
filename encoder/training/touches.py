"""Losses of lips that must meet for p, b and m, and of a lower lip that must lie on the teeth for f
and v.

Where a phone is not sure a squared error leaves both half done, which looks like neither. What is
missed and what is false is charged here instead; a touch may be two frames early or late.
"""

import torch
from torch import Tensor
from torch.nn import functional

from encoder.capture.speech.phones import LIP_CLOSING, PHONE_INDEX, TEETH_TOUCHING, VOWELS
from encoder.denoiser.config import PARTED_MM
from encoder.training.geometry import NEAR_FRAMES

SHUT_MM = 0.2  # what becomes of the lips in p, b, m
OPEN_MM = 1.6  # how far apart they stay in open vowels; in all else said PARTED_MM
TUCKED, LOOSE = 0.42, 0.08  # how far the lower lip rolls in f and v, and may beyond the truth


def meeting(
    now: Tensor,  # [B, T] mm between the lips
    moved: Tensor,  # [B, T] mm of it by the contact head
    wanted: Tensor,  # [B, T] mm, the truth
    phones: Tensor,  # [B, T], -1 unknown
    there: Tensor,  # [B, T] 1 where a frame is
    rarity: Tensor,  # [P + 1] weight of a frame by its phone
) -> dict[str, Tensor]:
    """Lips shut for p, b and m, stay open in vowels (or as they are, where phones are unknown) and
    apart in all else that is said far from p, b and m, and are moved no further than needed."""
    asked = _is(phones, LIP_CLOSING)
    closing = asked & (_least(wanted) < 1)
    idle = _far_from(asked)
    moves = moved.square() * there
    open_ = (_is(phones, VOWELS) | (phones < 0)) & (wanted > 2.5)
    missed = (_least(now) - SHUT_MM).relu().square() * closing * there * rarity[phones]
    floor = torch.where(open_, OPEN_MM, torch.where((phones > 0) & idle, PARTED_MM, -torch.inf))
    false = (floor - now).relu().square() * there
    count = there.sum()
    return {
        "miss": 10 * missed.sum() / count,
        "false": 10 * false.sum() / count,
        "effort": (moves * ~idle).sum() / count,
        "idle": (moves * idle).sum() / count,
    }


def tucking(
    roll: Tensor, wanted: Tensor, phones: Tensor, there: Tensor, rarity: Tensor
) -> dict[str, Tensor]:
    """How far the lower lip is rolled, shown and true [B, T]: in f and v onto the teeth, nowhere
    else much further than in the truth. Phones and the rest as in `meeting`."""
    asked = _is(phones, TEETH_TOUCHING)
    missed = (TUCKED - _most(roll)).relu().square() * (asked & (wanted > TUCKED / 2))
    false = (roll - wanted - LOOSE).relu().square() * _far_from(asked) * (phones >= 0)
    count = there.sum()
    return {
        "loose": (missed * there * rarity[phones]).sum() / count,
        "tucked": (false * there).sum() / count,
    }


def _is(phones: Tensor, names: tuple[str, ...]) -> Tensor:
    return torch.isin(phones, torch.tensor([PHONE_INDEX[name] for name in names]))


def _far_from(asked: Tensor) -> Tensor:  # [B, T] bool
    """Where none is asked within two frames."""
    return _most(asked.float()) == 0


def _most(x: Tensor) -> Tensor:  # [B, T]
    """The largest value within two frames."""
    return functional.max_pool1d(x[:, None], 2 * NEAR_FRAMES + 1, 1, NEAR_FRAMES)[:, 0]


def _least(x: Tensor) -> Tensor:
    return -_most(-x)
