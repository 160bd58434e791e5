"""Metrics of lips that follow a talker left out of training: r, timing, size, closures.

Compared with tracked curves alone (encoder/capture/subjects/tracked.py), never with what the rules
add to them. Lengths in mm on one avatar; used by `livedrive eval speech --leave-one-out`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from encoder.capture.speech.phones import LIP_CLOSING, Phone
from encoder.evaluation.metrics import SHUT_MM, Doubles, LipMarks, highpassed
from sensors.types import FPS

SHIFTS_MS = range(-120, 121, 5)
NEAR_S = 2 / FPS  # that a closure may be early or late


@dataclass(frozen=True, eq=False)
class TalkerClip:
    """Lips [T, n, 3] mm of a clip, shown and tracked, and its phones (empty: unknown)."""

    shown: np.ndarray
    tracked: np.ndarray
    phones: Sequence[Phone]


def openings(takes: Sequence[TalkerClip], marks: LipMarks) -> list[tuple[Doubles, Doubles]]:
    """Shown and tracked opening [T] mm of each clip; lips pressed together count as 0."""
    return [
        (np.maximum(marks.opening_mm(take.shown), 0), np.maximum(marks.opening_mm(take.tracked), 0))
        for take in takes
    ]


def widths(takes: Sequence[TalkerClip], marks: LipMarks) -> list[tuple[Doubles, Doubles]]:
    left, right = marks.corners

    def width(lips: np.ndarray) -> Doubles:
        return np.linalg.norm(lips[:, left] - lips[:, right], axis=-1).astype(np.float64)

    return [(width(take.shown), width(take.tracked)) for take in takes]


def correlation(
    pairs: Sequence[tuple[Doubles, Doubles]], change: Callable[[Doubles], Doubles] = np.asarray
) -> float:
    shown, tracked = (np.concatenate([change(pair[i]) for pair in pairs]) for i in (0, 1))
    return float(np.corrcoef(shown, tracked)[0, 1])


def best_shift_ms(pairs: Sequence[tuple[Doubles, Doubles]]) -> tuple[float, float]:
    """The shift with the largest r, and that r; above 0 the shown lips are late."""
    found = []
    for shift in SHIFTS_MS:
        moved = []
        for shown, tracked in pairs:
            at = np.arange(len(shown), dtype=np.float64)
            inside = slice(4, len(shown) - 4)
            moved.append((np.interp(at + shift * FPS / 1000, at, shown)[inside], tracked[inside]))
        found.append(correlation(moved))
    best = int(np.argmax(found))
    return float(SHIFTS_MS[best]), found[best]


def closures(takes: Sequence[TalkerClip], marks: LipMarks) -> dict[str, tuple[int, int]]:
    """p b m shown shut, and their number: at the start of speech after a pause, and within
    speech."""
    counts = {"initial": [0, 0], "inside": [0, 0]}
    for take in takes:
        opening, times = marks.opening_mm(take.shown), (np.arange(len(take.shown)) + 1) / FPS
        for before, phone in zip([None, *take.phones], take.phones, strict=False):
            if phone.name not in LIP_CLOSING:
                continue
            where = (times > phone.start - NEAR_S) & (times < phone.end + NEAR_S)
            if where.any():
                first = before is None or before.name == "pau"
                count = counts["initial" if first else "inside"]
                count[0] += bool(opening[where].min() < SHUT_MM)
                count[1] += 1
    return {name: (found, of) for name, (found, of) in counts.items()}


def figures(takes: Sequence[TalkerClip], marks: LipMarks) -> dict[str, float]:
    """Metrics of one talker: a row of the table."""
    opening, width = openings(takes, marks), widths(takes, marks)
    shift, best = best_shift_ms(opening)
    high = [np.quantile(np.concatenate([pair[i] for pair in opening]), 0.95) for i in (0, 1)]
    spread = [np.concatenate([pair[i] for pair in width]).std() for i in (0, 1)]
    result = {
        "r": correlation(opening),
        "r_fast": correlation(opening, highpassed),
        "r_best": best,
        "shift_ms": shift,
        "p95_ratio": float(high[0] / max(high[1], 1e-6)),
        "width_r": correlation(width),
        "width_ratio": float(spread[0] / max(spread[1], 1e-6)),
        "width_spread_mm": float(spread[0]),
    }
    for name, (found, of) in closures(takes, marks).items():
        if of:
            result[f"shut_{name}"] = found / of
    return result
