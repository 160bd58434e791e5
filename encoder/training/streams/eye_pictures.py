"""Training pictures of eyes with their truth, and random distortions of them.

Files hold small left-like pictures (`format.pixels`), so that a hundred thousand fit in
memory. The truth is rule-made: the capture stage drew these pictures from it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from encoder.eyes.format import ABOVE, BRIGHT, MIN_SPREAD, MOST, RIG, SIDE
from sensors import files
from sensors.types import InputError

ARRAYS = ("pictures", "gaze", "lids", "rig", "subject")
STRANGE = 0.35  # share of pictures under other light; the rest keep their fine detail
NEGATIVES = 0.12  # share of pictures that are no left eye before a working camera
KINDS_OF_NEGATIVES = 7


@dataclass(frozen=True, eq=False)
class EyePictures:
    """n pictures of single, left-like eyes."""

    pictures: np.ndarray  # [n, 100, 100] u8
    gaze: np.ndarray  # [n, 2] f32 x and y of the unit vector, +x away from the nose
    lids: np.ndarray  # [n] f32 opening, 0 shut .. 1 open
    rig: np.ndarray  # [n, 7] f32 RIG
    subject: np.ndarray  # [n] i32

    @staticmethod
    def load(folder: Path) -> EyePictures:
        """All shards eyes_*.npz of a folder: arrays of pairs, as `save_pairs` writes them."""
        paths = sorted(folder.glob("eyes_*.npz"))
        if not paths:
            raise InputError(
                f"eye pictures {folder}: expected files eyes_*.npz, got none; "
                f"run `livedrive capture {folder} --eyes 40000`"
            )
        rows = read_shards(paths, ARRAYS)
        if rows["pictures"].shape[1:] != (2, SIDE, SIDE):
            raise InputError(
                f"eye pictures {folder}: expected pictures [n, 2, {SIDE}, {SIDE}], got "
                f"{list(rows['pictures'].shape)}; capture again"
            )
        gaze = rows["gaze"][..., :2].astype(np.float32)
        gaze[:, 1, 0] *= -1  # the right eye becomes a left one
        return EyePictures(
            rows["pictures"].reshape(-1, SIDE, SIDE),
            gaze.reshape(-1, 2),
            np.clip(rows["lids"].astype(np.float32), 0, 1).reshape(-1),
            rows["rig"].astype(np.float32).reshape(-1, len(RIG)),
            np.repeat(rows["subject"].astype(np.int32), 2),
        )

    def where(self, chosen: np.ndarray) -> EyePictures:  # [n] bool
        arrays = (self.pictures, self.gaze, self.lids, self.rig, self.subject)
        return EyePictures(*(array[chosen] for array in arrays))


def read_shards(paths: Sequence[Path], names: Sequence[str]) -> dict[str, np.ndarray]:
    """The named arrays of all files, joined along the first axis.

    Raises InputError at a file that lacks one or has one of another shape than the first file.
    """
    parts: list[dict[str, np.ndarray]] = []
    for path in paths:
        with files.arrays(path, "remove it and capture again") as data:
            if missing := [name for name in names if name not in data]:
                raise InputError(
                    f"eye pictures {path}: expected {', '.join(names)}, got none of "
                    f"{', '.join(missing)}; capture again"
                )
            parts.append({name: data[name] for name in names})
        for name, array in parts[-1].items():
            if array.shape[1:] != parts[0][name].shape[1:]:
                raise InputError(
                    f"eye pictures {path}: expected {name} [n, *{parts[0][name].shape[1:]}] as in "
                    f"{paths[0].name}, got {list(array.shape)}; capture again"
                )
    return {name: np.concatenate([part[name] for part in parts]) for name in names}


def save_pairs(
    path: Path,
    pictures: np.ndarray,  # [n, 2, 100, 100] u8, of `pixels`
    gaze: np.ndarray,  # [n, 2, 3] unit vectors in the head's frame
    lids: np.ndarray,  # [n, 2]
    rig: np.ndarray,  # [n, 2, 7]
    subject: np.ndarray,  # [n]
) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with files.replacing(path) as draft:
        np.savez(
            draft, pictures=pictures, gaze=gaze.astype(np.float32), lids=lids.astype(np.float16),
            rig=rig.astype(np.float16), subject=subject.astype(np.int32),
        )  # fmt: skip


def _spread(count: int, low: float, high: float) -> Tensor:  # [B, 1, 1]
    return torch.empty(count, 1, 1).uniform_(low, high)


def _sometimes(count: int, chance: float) -> Tensor:  # [B, 1, 1] bool
    return torch.rand(count, 1, 1) < chance


def moved(x: Tensor, times: int = 1) -> Tensor:
    """Pictures [B, 100, 100] from cameras that sit nearer, elsewhere, or slightly rotated.

    Each run of B / `times` pictures has the same cameras.
    """
    count = len(x) // times
    zoom = torch.exp(torch.empty(count).uniform_(-0.1, 0.1))
    close = torch.rand(count) < 0.08  # cameras made at home sit closer
    zoom = torch.where(close, zoom * torch.empty(count).uniform_(1.2, 1.7), zoom)
    roll = torch.empty(count).uniform_(-0.03, 0.03)  # the renderer's cameras are turned already
    cos, sin = roll.cos() / zoom, roll.sin() / zoom
    shift = torch.empty(2, count).uniform_(-0.05, 0.05)
    rows = torch.stack([cos, -sin, shift[0], sin, cos, shift[1]], 1).reshape(count, 2, 3)
    rows = rows.repeat(times, 1, 1)
    grid = functional.affine_grid(rows, [len(rows), 1, SIDE, SIDE], align_corners=False)
    y = functional.grid_sample(x[:, None], grid, padding_mode="border", align_corners=False)
    return y[:, 0]


def lit(x: Tensor) -> Tensor:
    """Pictures [B, 100, 100] 0..255 under other light and from another sensor."""
    count = len(x)
    x = x * (1 + _spread(count, -0.5, 0.7) * (1 - x / 255))  # the sensor's response is bent
    ramp = torch.linspace(-1, 1, SIDE)
    slope = _spread(count, -0.4, 0.4) * ramp + _spread(count, -0.4, 0.4) * ramp[:, None]
    x = x * ((1 + slope) * torch.exp(_spread(count, -0.6, 0.5)))
    x = torch.where(_sometimes(count, 0.35), functional.avg_pool2d(x, 3, 1, 1), x)
    for _ in range(2):  # glints, wherever the lamps sit
        place, size = 0.25 * torch.randn(2, count, 1), _spread(count, 0.02, 0.07)[..., 0]
        across, down = (torch.exp(-(((ramp - p) / size) ** 2)) for p in place)
        light = _spread(count, 60, 255) * _sometimes(count, 0.2)
        x = torch.baddbmm(x, (light * down[..., None]), across[:, None])
    # the rim of the lens, or a cable, before a part of the picture
    angle = _spread(count, 0, 2 * torch.pi)
    beyond = ramp * angle.cos() + ramp[:, None] * angle.sin() > _spread(count, 0.65, 1.2)
    x = torch.where(beyond & _sometimes(count, 0.15), _spread(count, 0, 120), x)
    return (x + torch.randn_like(x) * _spread(count, 0, 6)).clamp(0, 255)


def no_eyes(x: Tensor, kind: Tensor) -> Tensor:
    """Pictures [B, 100, 100], kind [B] 0..6 -> pictures that show no eye."""
    count = len(x)
    level, noise = _spread(count, 0, 255), torch.randn_like(x)
    coarse = functional.interpolate(
        torch.randn(count, 1, 4, 4), size=(SIDE, SIDE), mode="bilinear", align_corners=False
    )[:, 0]
    others = (
        _spread(count, 0, 12) + noise * _spread(count, 0, 3),  # black, or a covered lens
        _spread(count, 235, 255) + noise * _spread(count, 0, 3),  # saturated
        level + noise * _spread(count, 0, 80),  # noise
        level + 60 * coarse + noise * _spread(count, 0, 4),  # cloth, a hand, a wall
        x.flip(2),  # the other eye: left and right are swapped
        x.flip(1),  # upside down
        torch.where(_sometimes(count, 0.5), x.roll(SIDE // 2, 2), x.roll(SIDE // 2, 1)),  # torn
    )
    for number, other in enumerate(others):
        x = torch.where((kind == number)[:, None, None], other, x)
    return x.clamp(0, 255)


def augmented(pictures: np.ndarray, times: int = 1) -> tuple[Tensor, Tensor]:
    """[B, 100, 100] u8 -> the network's input [B, 1, 100, 100], valid [B] bool; see `moved`."""
    x = moved(torch.from_numpy(pictures).float(), times)
    strange = torch.rand(len(x)) < STRANGE
    x[strange] = lit(x[strange])
    valid = torch.rand(len(x)) >= NEGATIVES
    if not valid.all():
        kind = torch.randint(0, KINDS_OF_NEGATIVES, (int((~valid).sum()),))
        x[~valid] = no_eyes(x[~valid], kind)
    return standard(x.round()), valid


def standard(x: Tensor) -> Tensor:
    """`format.normalised`, in torch: [B, n, n] -> [B, 1, n, n]."""
    step = x.shape[-1] // 25
    some = x[:, ::step, ::step].flatten(1).sort(1).values
    bright, usual = some[:, int(BRIGHT * (some.shape[1] - 1))], some[:, some.shape[1] // 2]
    x = torch.minimum(x, (bright + ABOVE * (bright - usual))[:, None, None])
    mean = x.mean((1, 2), keepdim=True)
    spread = x.std((1, 2), keepdim=True, correction=0).clamp(min=MIN_SPREAD)
    return ((x - mean) / spread).clamp(-MOST, MOST)[:, None]
