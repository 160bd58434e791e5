"""How `livedrive eval emotion` judges: codes with an emotion, which truth they are nearest to, and
what the lips keep of speech. The segments are those of emotion_sets.py.
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
    """In place of a random generator: the mean of each draw."""

    def uniform(self, low: float, high: float, size: int) -> NDArray[np.float64]:
        return np.full(size, (low + high) / 2)


def laid_over(
    rigs: Floats,  # [S, T, 53] of the neutral model
    labels: Sequence[int],
    strength: float,
    lips: LipGeometry,
) -> Floats:  # [S, T, 53]
    """The neutral model's lips, untouched but for the rules' own style at its mean strength.

    No sync is lost here. What this is worse by on emotional truth than the neutral model is on
    neutral truth is the price of not knowing how strongly this very take was acted, which no label
    tells: of what keeps the neutral model's lips, no more can be expected. (Fine-tuning, which
    replaces them by likelier and so less decided ones, passes below it and loses closures.)
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
    """One step at tau = N over whole segments; every emotion gets the same noise."""
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
    """The label whose truth is nearest, by the mean distance of the region's vertices."""
    shown = region(said)
    far = [np.linalg.norm(region(truth) - shown, axis=-1).mean() for truth in truths]
    return int(np.argmin(far))


def confusion(
    said: Floats, truths: Floats, labels: Sequence[int], region: Region
) -> Floats:  # [labels, labels], rows sum to 1 (asked for, nearest)
    """said [S, T, 256], truths [S, labels, T, 256] and the label asked for in each segment."""
    table = np.zeros((len(LABELS), len(LABELS)), np.float32)
    for row, versions, label in zip(said, truths, labels, strict=True):
        table[label, nearest(row, versions, region)] += 1
    return table / np.maximum(table.sum(1, keepdims=True), 1)


@dataclass(frozen=True, eq=False)
class Closures:
    """Of each segment [S]: closures of the truth, and how many of them are kept (mean of draws)."""

    of: metrics.Doubles
    kept: metrics.Doubles

    @property
    def recall(self) -> float:
        return float(self.kept.sum() / self.of.sum())


def closures_lost(
    ours: Closures, neutral: Closures, takes: Sequence[int], prefix: str
) -> dict[str, float]:
    """How much lower our recall is than the other's, its standard error, and of how many closures.

    takes [S], 0..: segments of one take, in whatever emotion, share their words and much else, so
    the error is that of a ratio over takes, not over closures.
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
    """`lip_sync_mm` as in the paper's tables; what the words make of the lips; closures.

    lip_sync_mm is |error| of the distances of the lips' corners and of their centres. Between the
    truths of two emotions it does not compare like with like: a smile that is a little narrower
    than this take's (its strength is drawn anew for every take) is an error of millimetres all
    through, and a mouth that moves 1.25 times as far errs 1.25 times as much at the same skill. So:
    lip_motion_error takes of the same two distances what moves faster than 0.5 Hz (syllables do,
    the emotion's swell does not) and divides the error by the truth's own motion: 0 is the truth,
    1 a still mouth. lip_motion_r is the correlation of the centres' part: a timid mouth cannot buy
    it.
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
    """Distances of the lips' corners and centres, without what changes slower than 0.5 Hz."""
    pairs = (mesh.marks.corners, mesh.marks.centres)
    spans = [np.linalg.norm(lips[:, a] - lips[:, b], axis=-1) for a, b in pairs]
    return metrics.highpassed(np.stack(spans))


def largest_moves(codes: Floats, region: Region) -> Floats:  # [T, 256] -> [T - 1] mm
    """The largest way of a vertex from each frame to the next."""
    return np.linalg.norm(np.diff(region(codes), axis=0), axis=-1).max(1)
