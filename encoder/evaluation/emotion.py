"""Metrics of `livedrive eval emotion`: codes with an emotion, the truth nearest to them, and how
well the lips keep to the speech. Segments come from emotion_sets.py.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from encoder.capture.motion.contacts import LipGeometry
from encoder.capture.motion.shift import best_shift
from encoder.denoiser.model import Denoiser
from encoder.denoiser.zero_conv import ZeroConvs
from encoder.emotion.labels import LABELS
from encoder.evaluation import metrics
from encoder.evaluation.judging import CLOSING, FaceMesh
from encoder.evaluation.rows import noise
from encoder.training.streams.emotion import with_emotion
from encoder.types import Floats

Region = Callable[[Floats], Floats]  # codes [T, 256] -> vertices [T, V, 3] mm


class _Mean:
    """Stands in for a random generator; every draw is its mean."""

    def uniform(self, low: float, high: float, size: int) -> NDArray[np.float64]:
        return np.full(size, (low + high) / 2)


def laid_over(
    rigs: Floats,  # [S, T, 53] of the neutral model
    labels: Sequence[int],
    strength: float,
    lips: LipGeometry,
) -> Floats:  # [S, T, 53]
    """Rigs [S, T, 53] of the neutral model with the rules' style added at its mean strength.

    The lip sync is the neutral model's. The error that this adds on emotional truth comes from not
    knowing how strongly a take was acted, which no label tells: a model that keeps the neutral lips
    cannot do better. (Fine-tuning, which replaces them by likelier and so less decided ones, gets
    below it and loses closures.)
    """
    mean: Any = _Mean()
    pairs = zip(rigs, labels, strict=True)
    return np.stack([with_emotion(x, LABELS[k], strength, lips, mean) for x, k in pairs])


@torch.no_grad()
def codes(
    student: Denoiser,
    zero: ZeroConvs | None,  # None: as it is
    audio: Tensor,  # [S, T, A]
    gaze: Tensor,  # [S, T, 6]
    labels: Sequence[int],  # of each segment
    intensity: float,
    seed: int,
) -> Floats:  # [S, T, 256]
    """Codes of one step at tau = N over whole segments; the noise is the same for all emotions."""
    rows = []
    tau = torch.tensor([student.config.num_steps])
    for index, label in enumerate(labels):
        x = noise((1, audio.shape[1], student.config.expression_dim), 1000 * seed + index)
        added = None
        if zero is not None:
            mixture = torch.zeros(1, len(LABELS))
            mixture[0, label] = intensity
            added = zero(mixture)
        a, g = audio[index : index + 1], gaze[index : index + 1]
        rows.append(student.unstandardise(student(x, tau, a, g, emotion=added))[0].numpy())
    return np.stack(rows)


def nearest(
    said: Floats,  # [T, 256]
    truths: Floats,  # [labels, T, 256]
    region: Region,
) -> int:
    """Index of the label whose truth is nearest, by mean distance of the region's vertices."""
    shown = region(said)
    far = [np.linalg.norm(region(truth) - shown, axis=-1).mean() for truth in truths]
    return int(np.argmin(far))


def confusion(
    said: Floats, truths: Floats, labels: Sequence[int], region: Region
) -> Floats:  # [labels, labels], rows sum to 1 (asked for, nearest)
    """Confusion of codes [S, T, 256], truths [S, labels, T, 256] and labels asked for [S]."""
    table = np.zeros((len(LABELS), len(LABELS)), np.float32)
    for row, versions, label in zip(said, truths, labels, strict=True):
        table[label, nearest(row, versions, region)] += 1
    return table / np.maximum(table.sum(1, keepdims=True), 1)


@dataclass(frozen=True, eq=False)
class Closures:
    """Closures in the truth of each segment [S], and how many are kept (mean of draws)."""

    of: metrics.Doubles
    kept: metrics.Doubles

    @property
    def recall(self) -> float:
        return float(self.kept.sum() / self.of.sum())


def closures_lost(
    ours: Closures, neutral: Closures, takes: Sequence[int], prefix: str
) -> dict[str, float]:
    """How much lower our recall is than the neutral model's, its standard error, and the number of
    closures.

    takes [S], 0..: segments of one take share their words whatever the emotion, so the standard
    error is that of a ratio over takes, not over closures.
    """
    if not ours.of.sum():
        return {}
    off, fall = np.zeros(max(takes) + 1), 0.0
    for one, sign in ((neutral, 1), (ours, -1)):
        fall += sign * one.recall
        off += sign * np.bincount(takes, one.kept - one.recall * one.of) / one.of.sum()
    return {
        f"{prefix}_closures_lost": fall,
        f"{prefix}_closures_lost_error": float(
            np.sqrt(len(off) / max(len(off) - 1, 1) * np.square(off).sum())
        ),
        f"{prefix}_closure_recall": neutral.recall,
        "closure_recall": ours.recall,
        "closures": float(ours.of.sum()),
    }


def lip_metrics(
    said: Sequence[Floats],  # draws of codes [S, T, 256]
    truths: Floats,  # [S, T, 256]
    phones: Sequence[NDArray[np.int64]],  # of each segment [T]
    mesh: FaceMesh,
) -> tuple[dict[str, float], Closures]:
    """`lip_sync_mm` as in the paper's tables; the part of lip motion due to words; closures.

    lip_sync_mm is |error| of the distances between the lips' corners and between their centres. It
    does not compare emotions fairly: a smile slightly narrower than this take's (strength is drawn
    for every take) is a constant error of millimetres, and a mouth that moves 1.25 times as far has
    1.25 times the error at the same skill. So lip_motion_error high-passes both distances at 0.5 Hz
    (syllables are faster, an emotion's swell is slower) and divides the error by the motion of the
    truth: 0 is the truth, 1 a still mouth. lip_motion_r is the correlation of the centres' part,
    which a mouth that moves too little does not improve.
    """
    spans, sync = list[metrics.Doubles](), list[float]()
    moved: list[list[metrics.Doubles]] = [[] for _ in said]
    of, kept = np.zeros(len(truths)), np.zeros(len(truths))
    for index, truth in enumerate(truths):
        real, closing = mesh.lips(truth), np.isin(phones[index], CLOSING)
        spans.append(_fast_spans_mm(mesh, real))
        for codes, fast in zip(said, moved, strict=True):
            lips = mesh.lips(codes[index])
            fast.append(_fast_spans_mm(mesh, lips))
            sync.append(mesh.marks.sync_error_mm(lips, real))
            openings = [mesh.marks.opening_mm(x) for x in (lips, real)]
            found, of[index] = metrics.closures(openings[0], openings[1], closing)
            kept[index] += found / len(said)
    motion, error, r = np.concatenate(spans, 1), list[float](), list[float]()
    for fast in moved:
        shown = np.concatenate(fast, 1)
        error.append(float(np.abs(shown - motion).mean() / np.abs(motion).mean()))
        r.append(max(best_shift(shown[1], motion[1], 0)[0], 0.0))
    result = {
        "lip_sync_mm": float(np.mean(sync)),
        "lip_motion_error": float(np.mean(error)),
        "lip_motion_r": float(np.mean(r)),
    }
    return result, Closures(of, kept)


def _fast_spans_mm(mesh: FaceMesh, lips: Floats) -> metrics.Doubles:  # [T, n, 3] -> [2, T]
    """Distances between the lips' corners and centres, high-passed at 0.5 Hz."""
    pairs = (mesh.marks.corners, mesh.marks.centres)
    spans = [np.linalg.norm(lips[:, a] - lips[:, b], axis=-1) for a, b in pairs]
    return metrics.highpassed(np.stack(spans))


def largest_moves(codes: Floats, region: Region) -> Floats:  # [T, 256] -> [T - 1] mm
    """Largest movement of any vertex between frames."""
    return np.linalg.norm(np.diff(region(codes), axis=0), axis=-1).max(1)
