"""Compares codes with the truth on the mesh: the columns of the paper's tables and more."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from encoder.capture.motion.channels import JAW_OPEN
from encoder.capture.motion.shift import best_shift
from encoder.capture.speech.phones import LIP_CLOSING, PHONE_INDEX
from encoder.evaluation import metrics
from encoder.evaluation.metrics import LipMarks
from encoder.evaluation.rows import Segment
from encoder.types import Doubles, Floats

CLOSING = tuple(PHONE_INDEX[name] for name in LIP_CLOSING)
OPEN_VOWELS = tuple(PHONE_INDEX[name] for name in ("aa", "ae", "ah", "ao", "aw", "ay", "eh"))
ONSET_FRAMES = 5
PIECE = 20  # frames of lip opening that the energy distance compares
BLINK = 0.5  # eyeBlink from which lids count as shut


@dataclass(frozen=True)
class FaceMesh:
    """The parts of the decoder that the metrics need, for one person."""

    lips: Callable[[Floats], Floats]  # codes [T, 256] -> [T, n, 3] mm
    upper_face: Callable[[Floats], Floats]  # codes [T, 256] -> [T, m, 3] mm
    blink: Callable[[Floats], Floats]  # codes [T, 256] -> [T] 0..1
    marks: LipMarks

    def opening_mm(self, codes: Floats) -> Doubles:  # [T, 256] -> [T]
        return self.marks.opening_mm(self.lips(codes))


@dataclass(frozen=True, eq=False)
class TruthMeshes:
    """Vertices of the truth of a set of segments, computed once for all rows."""

    segments: Sequence[Segment]
    lips: list[Floats]
    upper: list[Floats]
    openings: list[Doubles]

    @staticmethod
    def of(segments: Sequence[Segment], codes: Floats, mesh: FaceMesh) -> "TruthMeshes":
        lips = [mesh.lips(row) for row in codes]
        upper = [mesh.upper_face(row) for row in codes]
        return TruthMeshes(segments, lips, upper, [mesh.marks.opening_mm(row) for row in lips])


def judge(samples: Sequence[Floats], truth: TruthMeshes, mesh: FaceMesh) -> dict[str, float]:
    """K samples of codes [S, T, 256] of the same segments -> metrics, units in their names."""
    errors: dict[str, list[list[float]]] = {}
    openings: list[list[Doubles]] = []
    for codes in samples:
        drawn: list[Doubles] = []
        found: dict[str, list[float]] = {}
        for index, row in enumerate(codes):
            lips = mesh.lips(row)
            drawn.append(mesh.marks.opening_mm(lips))
            for name, value in _errors(row, lips, truth, index, mesh).items():
                found.setdefault(name, []).append(value)
        openings.append(drawn)
        for name, values in found.items():
            errors.setdefault(name, []).append(values)
    table = {name: np.array(values) for name, values in errors.items()}  # [K, S]
    result = {n: float(np.nanmean(v)) for n, v in table.items() if np.isfinite(v).any()}
    for name in ("lve_mm", "lip_sync_mm"):
        result[name.replace("_mm", "_best_mm")] = float(table[name].min(0).mean())
    minutes = sum(len(row) for row in samples[0]) / 1800
    blinks = [len(metrics.runs(mesh.blink(row) > BLINK)) for codes in samples for row in codes]
    result["blinks_per_minute"] = sum(blinks) / minutes / len(samples)
    return result | _opening_figures(openings, truth)


def _errors(
    codes: Floats, lips: Floats, truth: TruthMeshes, index: int, mesh: FaceMesh
) -> dict[str, float]:
    real = truth.lips[index]
    figures = {
        "lve_mm": metrics.lip_vertex_error_mm(lips, real),
        "fdd_mm": metrics.upper_face_deviation_mm(mesh.upper_face(codes), truth.upper[index]),
        "lip_sync_mm": mesh.marks.sync_error_mm(lips, real),
        "lip_velocity_mm": metrics.lip_velocity_error_mm(lips, real),
        "onset_lip_sync_mm": float("nan"),
    }
    phones = truth.segments[index].phones
    starts = np.flatnonzero((phones[1:] > 0) & (phones[:-1] == 0)) + 1
    rows = np.unique((starts[:, None] + np.arange(ONSET_FRAMES)).ravel())
    rows = rows[rows < len(phones)]
    if len(rows):
        figures["onset_lip_sync_mm"] = mesh.marks.sync_error_mm(lips[rows], real[rows])
    return figures


def _opening_figures(openings: list[list[Doubles]], truth: TruthMeshes) -> dict[str, float]:
    """Metrics of the opening of the lips, over all segments together."""
    real = np.concatenate(truth.openings)
    jaw = np.concatenate([s.rig[:, JAW_OPEN] for s in truth.segments]).astype(np.float64)
    phones = np.concatenate([segment.phones for segment in truth.segments])
    closing, vowels = np.isin(phones, CLOSING), np.isin(phones, OPEN_VOWELS)
    real_quick, jaw_quick = metrics.highpassed(real), metrics.highpassed(jaw)
    real_power = np.mean([metrics.syllable_power(row) for row in truth.openings])
    figures: dict[str, list[float]] = {}
    shut, shut_of, false, false_of = 0, 0, 0, 0
    for drawn in openings:
        guess = np.concatenate(drawn)
        r, shift = best_shift(guess, real)
        jaw_r, _ = best_shift(guess, jaw, 1)
        quick = metrics.highpassed(guess)
        fast, _ = best_shift(quick, real_quick, 1)
        jaw_fast, _ = best_shift(quick, jaw_quick, 1)
        power = np.mean([metrics.syllable_power(row) for row in drawn])
        for name, value in (
            ("opening_r", r),
            ("opening_shift_frames", shift),
            ("opening_fast_r", fast),
            ("jaw_r", jaw_r),  # against the label's own curve, as a tracker or rules gave it
            ("jaw_fast_r", jaw_fast),
            ("opening_spread_ratio", float(guess.std() / max(real.std(), 1e-6))),
            ("syllable_power_ratio", float(power / max(real_power, 1e-9))),
        ):
            figures.setdefault(name, []).append(value)
        found, total = metrics.closures(guess, real, closing)
        shut, shut_of = shut + found, shut_of + total
        found, total = metrics.false_closures(guess, real, vowels)
        false, false_of = false + found, false_of + total
    result = {name: float(np.mean(values)) for name, values in figures.items()}
    if shut_of:
        result["closure_recall"] = shut / shut_of
    if false_of:
        result["false_closures"] = false / false_of
    result["energy_distance_mm"] = metrics.energy_distance(
        _pieces([row for drawn in openings for row in drawn][: 4 * len(truth.openings)]),
        _pieces(truth.openings),
    )
    return result


def _pieces(openings: Sequence[NDArray[np.float64]]) -> Doubles:  # -> [n, PIECE]
    return np.concatenate([row[: len(row) // PIECE * PIECE].reshape(-1, PIECE) for row in openings])
