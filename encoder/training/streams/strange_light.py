"""Random light and camera faults, added to rendered pictures of eyes."""

from __future__ import annotations

import math

import torch
from torch import Tensor
from torch.nn import functional

from encoder.training.streams.camera_windows import sometimes, uniform

_noise = torch.randn(2_000_003, generator=torch.Generator().manual_seed(0))


def _some(count: int, share: float) -> Tensor:
    return torch.nonzero(sometimes(count, share))[:, 0]


def _each(count: int, low: float, high: float) -> Tensor:  # [B, 1, 1]
    return uniform(count, low, high)[:, None, None]


def _evenly(count: int, low: float, high: float) -> Tensor:  # [B, 1, 1] by order of magnitude
    return torch.exp(_each(count, math.log(low), math.log(high)))


def strange(
    x: Tensor,  # [B, n, n] 0..255
    window: Tensor,  # [B, n, n, 2] where the pixels lie in the camera's picture, -1..1
) -> Tensor:
    """Bent response, exposure, stray light, vignette, rim, glints, cables, blur, noise."""
    count, x = len(x), x / 255
    i = _some(count, 0.5)
    x[i] = x[i].clamp(min=1e-4) ** torch.exp(_each(len(i), -0.7, 0.6))
    x = x * torch.exp(_each(count, -1.2, 0.6))
    i = _some(count, 0.3)
    x[i] += _each(len(i), 0, 0.25)
    i = _some(count, 0.5)
    away = ((window[i] - 0.15 * torch.randn(len(i), 1, 1, 2)) ** 2).sum(-1)
    x[i] *= 1 - _each(len(i), 0, 1) * (away / 2).clamp(max=1)
    rim = sometimes(len(i), 0.5)
    few = int(rim.sum())
    dark = sometimes(few, 0.75)[:, None, None]
    tone = torch.where(dark, _each(few, 0, 0.08), _each(few, 0, 0.8))
    x[i[rim]] = torch.where(away[rim] > _each(few, 0.75, 1.25) ** 2, tone, x[i[rim]])
    for _ in range(2):
        i = _some(count, 0.2)
        near = ((window[i] - 0.5 * torch.randn(len(i), 1, 1, 2)) ** 2).sum(-1)
        x[i] += _each(len(i), 0.3, 1.5) * torch.exp(-near / _evenly(len(i), 0.015, 0.09) ** 2)
    i = _some(count, 0.12)
    angle = _each(len(i), 0, 2 * math.pi)
    along = window[i][..., 0] * angle.cos() + window[i][..., 1] * angle.sin()
    x[i] = torch.where(along > _each(len(i), 0.55, 1.2), _each(len(i), 0, 0.5), x[i])
    for share, size in ((0.3, 3), (0.12, 5)):
        i = _some(count, share)
        x[i] = functional.avg_pool2d(x[i][:, None], size, 1, size // 2)[:, 0]
    start = int(torch.randint(0, len(_noise) - x.numel(), (1,)))
    grain = _noise[start : start + x.numel()].view_as(x)
    return ((x + grain * _evenly(count, 0.002, 0.05)) * 255).clamp(0, 255).round()
