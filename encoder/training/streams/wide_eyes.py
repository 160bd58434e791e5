"""Eyes as real cameras take them: wide pictures with their truth, and batches for the networks.

`livedrive capture DIR --wide-eyes N` makes the files. Pictures are rendered and the truth is
rule-made.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from encoder.eyes.format import SIDE
from encoder.training.streams import camera_windows as cameras
from encoder.training.streams.eye_pictures import no_eyes, read_shards, standard
from encoder.training.streams.strange_light import strange
from sensors import files
from sensors.types import InputError

FINDER_SIDE = SIDE // 2
HELD_OUT = 12  # every twelfth person
WRONG_FRAME = (0.12, 0.06, 5.0)  # how far frames are off: log size, half widths, degrees
WRONG_USUAL = (0.06, 0.03, 2.0)  # in the headsets of `Look.draw`
WILD, WILD_SHARE = 2.5, 0.15  # times as wrong


@dataclass(frozen=True, eq=False)
class WidePictures:
    """n pictures of eyes, all as left ones, and their truth."""

    pictures: NDArray[np.uint8]  # [n, s, s]
    gaze: NDArray[np.float32]  # [n, 2]
    lids: NDArray[np.float32]  # [n]
    rig: NDArray[np.float32]  # [n, 7]
    subject: NDArray[np.int32]  # [n]
    frame: NDArray[np.float32]  # [n, 4] the eye's middle 0..1, mm across the picture, roll
    pupil: NDArray[np.float32]  # [n, 2] 0..1
    wide: NDArray[np.bool_]  # [n] in a headset of any kind
    no_eyes: NDArray[np.uint8]  # [m, s, s]

    @staticmethod
    def load(folder: Path) -> WidePictures:
        paths = sorted(folder.glob("wide_*.npz"))
        names = [field.name for field in fields(WidePictures)][:-1]
        none = folder / "no_eyes.npz"
        if not paths or not none.is_file():
            raise InputError(
                f"eye pictures {folder}: expected wide_*.npz and no_eyes.npz, got {len(paths)} and "
                f"{int(none.is_file())}; run `livedrive capture {folder} --wide-eyes 12000`"
            )
        rows = read_shards(paths, names)
        with files.arrays(none, "remove it and capture again") as data:
            return WidePictures(**rows, no_eyes=data["pictures"])

    def chosen(self, kind: str) -> NDArray[np.int64]:
        """Indices of "usual", "wide" or "all" pictures of the training split."""
        learned = self.subject % HELD_OUT != HELD_OUT - 1
        if kind != "all":
            learned &= self.wide == (kind == "wide")
        return np.flatnonzero(learned)


class BatchCounts(NamedTuple):
    """Numbers of pictures of each kind in a batch."""

    usual: int = 24  # in the headsets of `Look.draw`
    wide: int = 36
    skin: int = 5
    nothing: int = 10


class WideBatch(NamedTuple):
    """E eyes (usual, then wide), then skin, then pictures of no eye."""

    x: Tensor  # [B, 1, 100, 100] framed
    whole: Tensor  # [B, 1, 50, 50] for the finder
    index: NDArray[np.int64]  # [E] of the pictures
    shows: Tensor  # [B] 1 eye, 0 none
    told: Tensor  # [B] 1 where that is to be learned, else 0
    mirrored: Tensor  # [E] -1 where the framed picture is mirrored, else 1
    pupil: Tensor  # [E, 2] in half widths of the framed picture
    pupil_seen: Tensor  # [E] bool
    found: Tensor  # [E, 5] x, y, log size, cos and sin of the turn: of the whole picture


def _wrong(count: int, spread: tuple[float, float, float]) -> tuple[Tensor, Tensor, Tensor]:
    size, place, turn = spread
    wild = torch.where(cameras.sometimes(count, WILD_SHARE), WILD, 1.0)
    away = wild[:, None] * place * torch.randn(count, 2)
    return torch.exp(wild * size * torch.randn(count)), away, wild * turn * torch.randn(count)


def draw(data: WidePictures, counts: BatchCounts, rng: np.random.Generator) -> WideBatch:
    """Draw a batch: eyes, cameras, errors of the framing, light."""
    kinds = ("usual", "wide", "all")
    numbers = (counts.usual, counts.wide, counts.skin)
    index = np.concatenate(
        [rng.choice(data.chosen(k), n) for k, n in zip(kinds, numbers, strict=True)]
    )
    usual, eyes = counts.usual, counts.usual + counts.wide
    pictures = torch.from_numpy(data.pictures[index]).float()
    frame = torch.from_numpy(data.frame[index])
    skin, skin_told = cameras.beside(frame[eyes:])
    parts = [cameras.whole(frame[:usual]), cameras.drawn(frame[usual:eyes]), skin]
    windows = cameras.joined(parts)
    # frames as the finder will have them
    wrong = zip(_wrong(usual, WRONG_USUAL), _wrong(len(index) - usual, WRONG_FRAME), strict=True)
    size, place, turn = (torch.cat(pair) for pair in wrong)
    size, middle = size * windows.size, windows.eye + place * windows.size[:, None]
    roll = windows.roll + turn
    size[eyes:] = torch.exp(cameras.uniform(counts.skin, -1, 1))
    middle[eyes:] = 0.3 * torch.randn(counts.skin, 2)
    x, place_x = cameras.seen(pictures, windows, SIDE, middle, size, roll)
    halves = functional.avg_pool2d(pictures[:, None], 2)[:, 0]
    whole, place_whole = cameras.seen(halves, windows, FINDER_SIDE)
    nothing = [_nothing(data, counts.nothing, side, rng) for side in (SIDE, FINDER_SIDE)]
    x, place_x, whole, place_whole = (
        torch.cat([a, b])
        for a, b in zip((x, place_x, whole, place_whole), (*nothing[0], *nothing[1]), strict=True)
    )
    lit = torch.rand(len(x)) < torch.where(torch.arange(len(x)) < usual, 0.35, 0.85)
    x[lit] = strange(x[lit], place_x[lit])
    lit = torch.rand(len(whole)) < 0.8
    whole[lit] = strange(whole[lit], place_whole[lit])
    # the other eye in this one's place
    flipped = torch.zeros(len(x), dtype=torch.bool)
    flipped[usual:eyes] = cameras.sometimes(counts.wide, 0.3)
    x[flipped] = x[flipped].flip(2)
    mirrored = torch.where(flipped, -1.0, 1.0)[:eyes]
    whole_flipped = cameras.sometimes(len(whole), 0.5)
    whole[whole_flipped] = whole[whole_flipped].flip(2)
    shows, told = torch.zeros(len(x)), torch.ones(len(x))
    shows[:eyes] = 1
    told[:eyes], told[eyes : len(index)] = windows.shows_eye[:eyes].float(), skin_told.float()
    pupil, seen = _pupils(data, index[:eyes], windows, middle, size, roll)
    pupil[:, 0] *= mirrored
    side = torch.where(whole_flipped[:eyes], -1.0, 1.0)
    angle = torch.deg2rad(windows.roll[:eyes]) * side
    found = [windows.eye[:eyes, 0] * side, windows.eye[:eyes, 1], windows.size[:eyes].log()]
    return WideBatch(
        standard(x), standard(whole), index[:eyes], shows, told, mirrored, pupil, seen,
        torch.stack([*found, angle.cos(), angle.sin()], 1),
    )  # fmt: skip


def _pupils(
    data: WidePictures, index: NDArray[np.int64], windows: cameras.Windows,
    middle: Tensor, size: Tensor, roll: Tensor,
) -> tuple[Tensor, Tensor]:  # fmt: skip
    """Pupils [B, 2] in the framed pictures, and which of them are visible."""
    count, every = len(index), len(windows.half)
    points = torch.zeros(every, 2)
    points[:count] = torch.from_numpy(data.pupil[index])
    window = windows.place(points)[:count]
    place = cameras.turned(-roll[:count], (window - middle[:count]) / size[:count, None])
    shown = (window.abs() / windows.rim[:count, 0]).amax(1) < 1
    return place, shown & (place.abs().amax(1) < 1) & torch.from_numpy(data.lids[index] > 0.35)


def _nothing(
    data: WidePictures, count: int, side: int, rng: np.random.Generator
) -> tuple[Tensor, Tensor]:
    """Pictures without an eye [N, side, side], cut from larger ones."""
    chosen = rng.integers(len(data.no_eyes), size=count)
    pictures = torch.from_numpy(data.no_eyes[chosen]).float()
    zero, one = torch.zeros(count), torch.ones(count)
    windows = cameras.Windows(
        middle=0.5 + 0.1 * torch.randn(count, 2),
        half=0.5 * torch.exp(cameras.uniform(count, -1, 0)),
        turn=cameras.uniform(count, -180, 180),
        rim=torch.ones(count, 1, 2), eye=torch.zeros(count, 2), size=one, roll=zero,
    )  # fmt: skip
    size = torch.exp(cameras.uniform(count, -1, 1))
    away, roll = 0.3 * torch.randn(count, 2), 15 * torch.randn(count)
    frame = (away, size, roll) if side == SIDE else (None, None, None)
    x, place = cameras.seen(pictures, windows, side, *frame)
    flat = cameras.sometimes(count, 0.3)
    if flat.any():  # black, saturated, noise, cloth
        wide = functional.interpolate(x[flat][:, None], size=(SIDE, SIDE))[:, 0]
        odd = no_eyes(wide, torch.randint(0, 4, (len(wide),)))
        x[flat] = functional.interpolate(odd[:, None], size=(side, side), mode="area")[:, 0]
    return x, place
