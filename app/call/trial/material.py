"""Test material of a trial: sound, the matching codes, and the positions of the lips."""

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.call.wire.packet import RIG_DIM, Basis
from sensors import files
from sensors.types import SAMPLE_RATE, SAMPLES_PER_FRAME

Floats = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Material:
    """Played in a loop; tick i belongs to the sound that ends at sample 1600 (i + 1)."""

    sound: Floats  # [T * 1600]
    expression: Floats  # [T, 256]
    gaze: Floats  # [T, 2, 3]
    rows: Floats  # [55, 256] of the basis
    reach: Floats  # [55]
    lips: Floats  # [256, 3 V] mm of the lips a unit of the code

    @property
    def basis(self) -> Basis:
        return Basis(self.rows, self.reach)

    def save(self, path: Path) -> None:
        np.savez(path, **{f.name: getattr(self, f.name) for f in fields(self)})


def load_material(path: Path) -> Material:
    arrays = files.load_npz(path)
    return Material(**{f.name: arrays[f.name] for f in fields(Material)})


def synthetic_material(seconds: int, seed: int) -> Material:
    """Voiced syllables and a face that opens with them; needs no weights."""
    rng = np.random.default_rng(seed)
    ticks = seconds * 30
    t = np.arange(ticks * SAMPLES_PER_FRAME) / SAMPLE_RATE
    knots = np.linspace(0, seconds, seconds * 5 + 1)
    open_ = np.interp(t, knots, rng.uniform(0, 1, len(knots)) ** 2)
    pitch = np.interp(t, knots, rng.uniform(90, 180, len(knots)))
    phase = 2 * np.pi * np.cumsum(pitch) / SAMPLE_RATE
    voice = sum(np.sin(k * phase) / k for k in range(1, 25)) + 0.2 * rng.standard_normal(len(t))
    rows = np.linalg.qr(rng.standard_normal((256, RIG_DIM)))[0].T
    ends = open_[SAMPLES_PER_FRAME - 1 :: SAMPLES_PER_FRAME]
    wander = np.cumsum(rng.standard_normal((ticks, RIG_DIM)), 0) * 0.3
    wander -= np.linspace(0, 1, ticks)[:, None] * wander[-1]  # the loop closes
    code = np.clip(wander, -25, 25)
    code[:, 0] = 25 * ends
    gaze = np.tile(np.array([[0, 0, 1], [0, 0, 1]], np.float32), (ticks, 1, 1))
    return Material(
        sound=(0.15 * open_ * voice).astype(np.float32),
        expression=(code @ rows).astype(np.float32),
        gaze=gaze,
        rows=rows.astype(np.float32),
        reach=np.full(RIG_DIM, 30, np.float32),
        lips=(0.05 * rng.standard_normal((256, 30)) / 16).astype(np.float32),
    )
