"""Camera pictures cut from wide ones, and framed as the eye network gets them; in torch.

A window is the picture of a camera, anywhere on a wide picture. A frame is the part of a window in
which the finder locates the eye. Beyond the rim of a window edges are repeated, as in
encoder/eyes/framing.py.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from encoder.eyes.framing import FRAME_MM

NEAREST, FARTHEST = 14.0, 78.0  # mm that a camera sees across
USUAL = (30.0, 60.0)
USUAL_SHARE, TURNED_SHARE, ASIDE_SHARE, OBLONG_SHARE = 0.3, 0.3, 0.2, 0.35
MOST_TURN = 42.0  # degrees
SEEN = 0.93  # half widths from a window's middle, up to which an eye counts as shown


def uniform(count: int, low: float, high: float) -> Tensor:
    return torch.empty(count).uniform_(low, high)


def sometimes(count: int, share: float) -> Tensor:
    return torch.rand(count) < share


def rotations(degrees: Tensor) -> Tensor:  # [B] -> [B, 2, 2], clockwise as seen (+y is down)
    cos, sin = torch.deg2rad(degrees).cos(), torch.deg2rad(degrees).sin()
    return torch.stack([torch.stack([cos, -sin], -1), torch.stack([sin, cos], -1)], -2)


def turned(degrees: Tensor, points: Tensor) -> Tensor:  # [B], [B, 2] -> [B, 2]
    return (rotations(degrees) @ points[..., None])[..., 0]


@dataclass
class Windows:
    """B windows, and where the eye lies in each: the target of the finder."""

    middle: Tensor  # [B, 2] in widths of the wide picture
    half: Tensor  # [B] half width, likewise
    turn: Tensor  # [B] degrees
    rim: Tensor  # [B, 1, 2] half widths that are shown: less than 1 where the camera is oblong
    eye: Tensor  # [B, 2] the eye's middle in half widths of the window
    size: Tensor  # [B] half width of its frame, likewise
    roll: Tensor  # [B] degrees of the eye in the window

    def place(self, points: Tensor) -> Tensor:
        """Points [B, 2] of the wide picture, 0..1 -> half widths of the window."""
        return turned(-self.turn, (points - self.middle) / self.half[:, None])

    @property
    def shows_eye(self) -> Tensor:  # [B] bool
        return (self.eye.abs() / self.rim[:, 0]).amax(1) < SEEN


def whole(frame: Tensor) -> Windows:
    """Windows that show the wide pictures unchanged; frame [B, 4]: x, y, mm across, roll."""
    count, ones = len(frame), torch.ones(len(frame))
    return Windows(
        middle=torch.full((count, 2), 0.5), half=0.5 * ones, turn=0 * ones,
        rim=torch.ones(count, 1, 2), eye=(frame[:, :2] - 0.5) / 0.5,
        size=FRAME_MM / frame[:, 2], roll=frame[:, 3].clone(),
    )  # fmt: skip


def drawn(frame: Tensor) -> Windows:
    """Random cameras: near or far, rotated, off centre, not square."""
    count = len(frame)
    across = torch.exp(uniform(count, math.log(NEAREST), math.log(FARTHEST)))
    usual = torch.exp(uniform(count, *map(math.log, USUAL)))
    across = torch.where(sometimes(count, USUAL_SHARE), usual, across)
    eye = 0.22 * torch.randn(count, 2)
    anywhere = uniform(2 * count, -0.95, 0.95).view(count, 2)
    eye = torch.where(sometimes(count, ASIDE_SHARE)[:, None], anywhere, eye).clamp(-0.98, 0.98)
    far = uniform(count, -MOST_TURN, MOST_TURN)
    turn = torch.where(sometimes(count, TURNED_SHARE), far, 9 * torch.randn(count))
    half = across / 2 / frame[:, 2]
    rim = torch.ones(count, 1, 2)
    oblong = sometimes(count, OBLONG_SHARE)
    rim[:, 0, 1] = torch.where(oblong, uniform(count, 0.55, 0.8), torch.ones(count))
    upright = oblong & sometimes(count, 0.1)
    rim = torch.where(upright[:, None, None], rim.flip(2), rim)
    middle = frame[:, :2] - turned(turn, eye * half[:, None])
    size = FRAME_MM / 2 / frame[:, 2] / half
    return Windows(middle, half, turn, rim, eye, size, frame[:, 3] - turn)


def beside(frame: Tensor) -> tuple[Windows, Tensor]:
    """Windows on skin and hair without the eye; and whether there is enough skin [B]."""
    count = len(frame)
    result = drawn(frame)
    angle, away = uniform(count, 0, 2 * math.pi), uniform(count, 1.7, 2.6)
    result.half = uniform(count, 0.12, 0.3)
    result.rim = torch.ones(count, 1, 2)
    reach = away * result.half + 16 / frame[:, 2]
    result.middle = frame[:, :2] + torch.stack([angle.cos(), angle.sin()], 1) * reach[:, None]
    room = 0.8 * result.half[:, None]
    return result, ((result.middle > room) & (result.middle < 1 - room)).all(1)


def joined(parts: list[Windows]) -> Windows:
    names = Windows.__dataclass_fields__
    return Windows(**{name: torch.cat([getattr(p, name) for p in parts]) for name in names})


def seen(
    pictures: Tensor,  # [B, n, n] wide ones
    windows: Windows,
    side: int,
    middle: Tensor | None = None,  # [B, 2] of a frame in the window; default: all of the window
    size: Tensor | None = None,  # [B]
    roll: Tensor | None = None,  # [B] degrees
) -> tuple[Tensor, Tensor]:
    """Framed pictures [B, side, side], and where their pixels lie in the window [B, .., 2]."""
    axis = torch.linspace(-1 + 1 / side, 1 - 1 / side, side)
    down, across = torch.meshgrid(axis, axis, indexing="ij")
    grid = torch.stack([across, down], -1).view(1, -1, 2).expand(len(pictures), -1, -1)
    if middle is not None and size is not None and roll is not None:
        grid = grid @ rotations(roll).transpose(1, 2) * size[:, None, None] + middle[:, None]
    grid = torch.maximum(torch.minimum(grid, windows.rim), -windows.rim)
    place = grid @ rotations(windows.turn).transpose(1, 2) * windows.half[:, None, None]
    place = 2 * (place + windows.middle[:, None]) - 1
    shape = (len(pictures), side, side, 2)
    result = functional.grid_sample(
        pictures[:, None], place.view(shape), padding_mode="border", align_corners=False
    )
    return result[:, 0], grid.view(shape)
