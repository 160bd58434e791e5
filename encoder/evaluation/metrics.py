"""Metrics of motion, from vertices in millimetres; used by `livedrive eval`.

Pure functions of arrays: nothing here knows networks, files or pictures. The first four are the
paper's (section 6.1, table 2), which gives no formulas: the docstrings say what is computed here.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from encoder.types import Doubles, Floats
from sensors.types import FPS, SAMPLE_RATE, SAMPLES_PER_FRAME

MIDDLE_MM = 8.0  # half width of the middle of the lips, where the opening is measured
NUM_PAIRS = 8
ENVELOPE_BAND_HZ = (2.0, 15.0)
SYLLABLE_BAND_HZ = (2.0, 7.0)
SHUT_MM = 1.0  # lips this close look shut
OPEN_MM = 3.0
NEAR_FRAMES = 2  # a closure may be this early or late


def lip_vertex_error_mm(predicted: Floats, truth: Floats) -> float:
    """LVE. Lips [T, n, 3] -> the largest L2 error of a frame's vertices, mean over frames."""
    return float(np.linalg.norm(predicted - truth, axis=-1).max(1).mean())


def upper_face_deviation_mm(predicted: Floats, truth: Floats) -> float:
    """FDD. Upper face [T, m, 3] -> |difference of the spread over time of each vertex|, mean.

    The spread is the standard deviation of the vertex's distance from its mean place in the truth.
    """
    centre = truth.mean(0)
    spread = [np.linalg.norm(v - centre, axis=-1).std(0) for v in (predicted, truth)]
    return float(np.abs(spread[0] - spread[1]).mean())


def lip_velocity_error_mm(predicted: Floats, truth: Floats) -> float:
    """Lip Vel. As LVE, of the lips' frame-to-frame motion, in mm a frame."""
    return lip_vertex_error_mm(np.diff(predicted, axis=0), np.diff(truth, axis=0))


@dataclass(frozen=True)
class LipMarks:
    """Rows of the lip vertices between which lip sync is measured."""

    corners: tuple[int, int]  # subject's left, right
    centres: tuple[int, int]  # upper, lower
    pairs: NDArray[np.int64]  # [NUM_PAIRS, 2] touching vertices of the inner lips, upper and lower

    @staticmethod
    def find(lips: Floats, upper: NDArray[np.int64], lower: NDArray[np.int64]) -> "LipMarks":
        """From lips [n, 3] mm at rest, and which of their rows are upper and lower lip."""
        x = lips[:, 0]
        pairs = inner_lip_pairs(lips[upper], lips[lower])
        pairs = np.stack([upper[pairs[:, 0]], lower[pairs[:, 1]]], 1)
        middle = pairs[np.abs(x[pairs].mean(1) - x.mean()).argmin()]
        return LipMarks((int(x.argmax()), int(x.argmin())), (int(middle[0]), int(middle[1])), pairs)

    def opening_mm(self, lips: Floats) -> Doubles:  # [T, n, 3] -> [T]
        """Vertical gap of the inner lips; below zero where they press into each other."""
        gap = lips[:, self.pairs[:, 0], 1].astype(np.float64) - lips[:, self.pairs[:, 1], 1]
        return gap.mean(1)

    def sync_error_mm(self, predicted: Floats, truth: Floats) -> float:
        """Lip Sync. |error of the corners' distance| + |error of the centres' distance|, mean."""
        return float(sum(self._distance_error(p, predicted, truth) for p in self._spans))

    @property
    def _spans(self) -> tuple[tuple[int, int], tuple[int, int]]:
        return self.corners, self.centres

    @staticmethod
    def _distance_error(pair: tuple[int, int], predicted: Floats, truth: Floats) -> float:
        a, b = pair
        guess, real = (np.linalg.norm(v[:, a] - v[:, b], axis=-1) for v in (predicted, truth))
        return float(np.abs(guess - real).mean())


def inner_lip_pairs(
    upper: Floats,  # [n, 3] mm, the upper lip at rest
    lower: Floats,  # [m, 3] mm, the lower lip at rest
) -> NDArray[np.int64]:  # [NUM_PAIRS, 2] rows of upper and of lower
    """Vertices that touch, or nearly, when the mouth is at rest: the inner lips at mid-mouth."""
    middle = np.flatnonzero(np.abs(upper[:, 0] - upper[:, 0].mean()) < MIDDLE_MM)
    distance = np.linalg.norm(upper[middle, None] - lower[None], axis=-1)
    nearest = np.argsort(distance.min(1), kind="stable")[:NUM_PAIRS]
    return np.stack([middle[nearest], distance[nearest].argmin(1)], 1)


def envelope(audio: Floats) -> Doubles:  # [T * 1600] 48 kHz -> [T]
    """The sound's 2-15 Hz amplitude envelope at the end of each frame (zero phase: not causal)."""
    from scipy.signal import butter, hilbert, sosfiltfilt

    low, high = ENVELOPE_BAND_HZ
    loud = np.abs(np.asarray(hilbert(audio)))
    loud = sosfiltfilt(butter(4, high, fs=SAMPLE_RATE, output="sos"), loud)
    eight = SAMPLES_PER_FRAME // 8  # 240 Hz: the high-pass is exact there
    slow = sosfiltfilt(butter(2, low, "highpass", fs=8 * FPS, output="sos"), loud[::eight])
    return slow[7::8][: len(audio) // SAMPLES_PER_FRAME]


def highpassed(curve: Doubles, hz: float = 0.5) -> Doubles:  # [T] -> [T]
    """The curve high-passed at `hz`, zero phase."""
    from scipy.signal import butter, sosfiltfilt

    return np.asarray(sosfiltfilt(butter(2, hz, "highpass", fs=FPS, output="sos"), curve))


def movement_mm(opening: Doubles, settle: int = FPS // 2) -> float:
    """Peak-to-peak movement of the lips after the first half second."""
    return float(np.ptp(opening[settle:]))


def syllable_power(opening: Doubles) -> float:  # [T] -> mm^2
    """Power of the lips' opening between 2 and 7 Hz."""
    spectrum = np.abs(np.fft.rfft(opening - opening.mean())) ** 2 / len(opening) ** 2
    hz = np.fft.rfftfreq(len(opening), 1 / FPS)
    low, high = SYLLABLE_BAND_HZ
    return float(2 * spectrum[(hz >= low) & (hz <= high)].sum())


def runs(where: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """[T] -> (start, stop) of each stretch of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], where, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def closures(
    opening: Doubles,  # [T] mm, predicted
    truth: Doubles,  # [T] mm
    closing: NDArray[np.bool_],  # [T] p, b or m sounds
) -> tuple[int, int]:
    """Number of closures that the prediction has within +-2 frames, and number in the truth."""
    found = total = 0
    for start, stop in runs(closing):
        window = slice(max(start - NEAR_FRAMES, 0), stop + NEAR_FRAMES)
        if truth[window].min() < SHUT_MM:
            total += 1
            found += bool(opening[window].min() < SHUT_MM)
    return found, total


def false_closures(opening: Doubles, truth: Doubles, vowels: NDArray[np.bool_]) -> tuple[int, int]:
    """Number of open vowels in which the prediction shuts the lips, and number in the truth."""
    found = total = 0
    for start, stop in runs(vowels):
        if truth[start:stop].min() > OPEN_MM:
            total += 1
            found += bool(opening[start:stop].min() < SHUT_MM)
    return found, total


def energy_distance(samples: Doubles, truth: Doubles) -> float:
    """Between two sets of motions [n, d] and [m, d]: 2 E|x - y| - E|x - x'| - E|y - y'|.

    Zero only for equal distributions: predicting the mean scores badly, sampling scores well.
    """

    def mean_distance(a: Doubles, b: Doubles) -> float:
        return float(np.mean([np.linalg.norm(row - b, axis=-1).mean() for row in a]))

    def within(a: Doubles) -> float:
        return mean_distance(a, a) * len(a) / max(len(a) - 1, 1)

    return 2 * mean_distance(samples, truth) - within(samples) - within(truth)
