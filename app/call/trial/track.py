"""Where what is heard lies in what was said, window by window.

A voice is periodic: a window of it lies a period of the pitch (3 to 12 ms) off almost as well as
where it belongs. So every place that is alike is kept, and the smoothest track through all windows
decides.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sensors.types import SAMPLE_RATE

WINDOW = SAMPLE_RATE // 4  # samples of sound that are found in what was said
ALIKE = 0.5  # correlation from which a place counts
MOST, APART = 24, SAMPLE_RATE // 2000  # places of a window, and samples between two
SPEED = 0.02  # more or less, at which sound is played while its delay adapts
SPEEDS = np.linspace(1 - SPEED, 1 + SPEED, 17)
WITHIN_MS = 1.0  # of the truth a window is found
PART = round(WINDOW * 0.96)  # samples of a window that are there at every speed
SHARPEN = 0.95  # without its slow part a voice is found more clearly
# What a track pays in correlation. A period of the pitch off gains 0.08 at most, and goes there and
# back; to where the delay really goes every way costs alike.
WAY, MOST_MS = 0.01, 30.0  # for each ms of delay, up to so many
JUMP = 0.05  # more, where no speed explains it
LEFT_OUT = 0.2  # for a window: less than there and back, as nothing goes so at once
IN_A_ROW = 3  # left out at most
Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Matches:
    """Where a window of sound may belong."""

    t_ns: float  # our clock at its middle
    late_ms: Floats  # [k] how long before it was said
    alike: Floats  # [k] correlation


def matches(heard: Floats, said: Floats) -> tuple[Floats, Floats]:
    """[k] at which samples of `said` the middle of `heard` [WINDOW] may be, the likeliest first,
    and [k] correlations there.

    While the delay adapts, sound is faster or slower by up to 2 %: 5 ms within a window, which a
    search at one speed does not find, or finds elsewhere."""
    size = 1 << (len(said) + PART - 1).bit_length()
    said = said[1:] - SHARPEN * said[:-1]
    spectrum = np.fft.rfft(said, size)
    squares = np.concatenate([[0], np.cumsum(said * said)])
    energy = squares[PART - 1 :] - squares[: 1 - PART]
    alike = np.zeros(len(energy))
    for speed in SPEEDS:
        at = len(heard) / 2 + (np.arange(PART, dtype=np.float64) - PART / 2) / float(speed)
        played = np.interp(at, np.arange(len(heard), dtype=np.float64), heard)
        here = played[1:] - SHARPEN * played[:-1]
        product = np.fft.irfft(spectrum * np.conj(np.fft.rfft(here, size)), size)[: len(energy)]
        alike = np.maximum(alike, product / np.sqrt(np.maximum(energy * (here @ here), 1e-9)))
    inner = alike[1:-1]
    peaks = 1 + np.flatnonzero((inner >= ALIKE) & (inner > alike[:-2]) & (inner >= alike[2:]))
    peaks = _apart(peaks[np.argsort(-alike[peaks])])
    exact = peaks + PART / 2 + vertex(alike[peaks - 1], alike[peaks], alike[peaks + 1])
    return exact, alike[peaks]


def track(windows: Sequence[Matches]) -> Floats:
    """[n, 2]: t_ns and late_ms of one place of each window: those that are most alike, and lie
    where sound that is played up to 2 % off speed goes from window to window. A jump is believed
    where the sound says so clearly; windows that fit nowhere are left out."""
    costs: list[Floats] = []
    origins: list[list[tuple[int, int]]] = []  # window and place before, of each place
    for n, window in enumerate(windows):
        least = np.full(len(window.alike), n * LEFT_OUT)
        before = [(-1, -1)] * len(least)
        for m in range(max(n - 1 - IN_A_ROW, 0), n):
            past = windows[m]
            by_ms = window.late_ms[:, None] - past.late_ms
            jumped = jumps(by_ms, window.t_ns - past.t_ns)
            ways = costs[m] + WAY * np.minimum(np.abs(by_ms), MOST_MS) + JUMP * jumped
            ways += (n - 1 - m) * LEFT_OUT
            for k, way in enumerate(ways.argmin(1)):
                if ways[k, way] < least[k]:
                    least[k], before[k] = ways[k, way], (m, int(way))
        costs.append(least + window.alike.max() - window.alike)
        origins.append(before)
    return _followed(windows, costs, origins)


def jumps(late_ms: Floats, passed_ns: float | Floats) -> NDArray[np.bool_]:
    """Whether the delay changed by more than playing faster or slower explains."""
    return np.abs(late_ms) > SPEED * passed_ns / 1e6 + WITHIN_MS


def _apart(peaks: NDArray[np.int64]) -> NDArray[np.int64]:
    """The first of those that are near each other."""
    kept: list[int] = []
    for peak in peaks.tolist():
        if len(kept) < MOST and all(abs(peak - other) >= APART for other in kept):
            kept.append(peak)
    return np.array(kept, np.int64)


def _followed(
    windows: Sequence[Matches], costs: list[Floats], origins: list[list[tuple[int, int]]]
) -> Floats:
    """The cheapest track, back from its end."""
    ends = [cost.min() + (len(costs) - 1 - n) * LEFT_OUT for n, cost in enumerate(costs)]
    rows: list[tuple[float, float]] = []
    n = int(np.argmin(ends)) if ends else -1
    k = int(costs[n].argmin()) if ends else -1
    while n >= 0:
        rows.append((windows[n].t_ns, float(windows[n].late_ms[k])))
        n, k = origins[n][k]
    return np.array(rows[::-1], np.float64).reshape(-1, 2)


def vertex(left: Floats, middle: Floats, right: Floats) -> Floats:
    """Where between -1 and 1 the parabola through three values has its extreme."""
    return 0.5 * (left - right) / (left - 2 * middle + right + 1e-12)
