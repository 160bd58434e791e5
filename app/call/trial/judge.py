"""Delays and errors between what one end sent and the other received, measured independently:
by comparing sound with sound and codes with codes.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.call.media.opus import PACKET
from app.call.trial.material import Material
from sensors.types import FPS, NS, SAMPLE_RATE, SAMPLES_PER_FRAME

WINDOW = SAMPLE_RATE // 4  # samples of sound that are found in what was said
SEARCH = SAMPLE_RATE // 2  # samples later than it was said at most
ALIKE = 0.5  # correlation from which a window counts
SPEED = 0.02  # more or less, at which sound is played while its delay adapts
SPEEDS = np.linspace(1 - SPEED, 1 + SPEED, 17)
WITHIN_MS = 1.0  # of the truth a window is found
PART = round(WINDOW * 0.96)  # samples of a window that are there at every speed
STEP_MS = 2.0
SHIFTS_MS = np.arange(-120, 120 + STEP_MS, STEP_MS)  # of the face that are tried
CLEAR = 0.5  # of the median miss: a face that hardly moves fits everywhere and tells no time
AFTER_LATE_NS = NS // 4  # in which a packet that was sent late would have been due
SHARPEN = 0.95  # voice is periodic and low; without its slow part it is found without doubt


@dataclass(frozen=True)
class Found:
    """One end's files."""

    report: dict[str, Any]
    heard: NDArray[np.float32]
    seen_ns: NDArray[np.int64]
    seen: NDArray[np.float32]  # [N, 256]
    ticks: NDArray[np.int64]
    codes: NDArray[np.float32]  # [M, 256]


def load_found(path: Path) -> Found:
    with np.load(path) as file:
        report = json.loads(str(file["report"]))
        return Found(
            report, *(file[name] for name in ("heard", "seen_ns", "seen", "ticks", "codes"))
        )


def delays_ms(here: Found, there: Found, material: Material) -> NDArray[np.float64]:
    """[n, 2]: our clock in ns at the middle of each window of sound, and how long before what is
    heard there was said, in ms."""
    start = there.report["settings"]["start"] * SAMPLES_PER_FRAME
    first_ns, origin_ns = here.report["first_heard_ns"], there.report["origin_ns"]
    rows: list[tuple[float, float]] = []
    for at in range(0, len(here.heard) - WINDOW + 1, WINDOW):
        heard_ns = first_ns + at * 1e9 / SAMPLE_RATE
        said_by_now = round((heard_ns - origin_ns) * SAMPLE_RATE / 1e9)
        first = said_by_now - SEARCH + start
        reach = (first + np.arange(SEARCH + WINDOW, dtype=np.int64)) % len(material.sound)
        said = material.sound[reach].astype(np.float64)
        lag = _middle(here.heard[at : at + WINDOW].astype(np.float64), said)
        if lag is not None:
            late_ms = (SEARCH + WINDOW / 2 - lag) * 1e3 / SAMPLE_RATE
            rows.append((heard_ns + WINDOW / 2 * 1e9 / SAMPLE_RATE, late_ms))
    return steady(np.array(rows, np.float64).reshape(-1, 2))


def steady(delays: NDArray[np.float64]) -> NDArray[np.float64]:
    """[n, 2] without windows that were found a period of the voice's pitch off: no sound that is
    played up to 2 % off speed goes there and comes back between the windows around."""
    apart = np.abs(np.diff(delays[:, 1])) - SPEED * np.diff(delays[:, 0]) / 1e6 > WITHIN_MS
    across = np.abs(delays[2:, 1] - delays[:-2, 1])
    returns = across - SPEED * (delays[2:, 0] - delays[:-2, 0]) / 1e6 <= WITHIN_MS
    alone = apart[:-1] & apart[1:] & returns
    return delays[np.concatenate([[True], ~alone, [True]])[: len(delays)]]


def lips_ms(
    here: Found, there: Found, material: Material, delays: NDArray[np.float64]
) -> NDArray[np.float64]:
    """[n] for each second in which the face moves: how much later it is than the sound, in ms.

    It is the shift by which the poses of that second fit best what the other's face did. Where no
    sound is found there is nothing that the face could be early or late to: in silence, and while
    the machine stalls (`stalled_ms` of the report), when the card plays nothing.
    """
    if not len(delays):
        return np.zeros(0)
    origin_ns, start = there.report["origin_ns"], there.report["settings"]["start"]
    stalls_ns = np.array(here.report["stalls_ns"], np.int64)
    delay = np.interp(here.seen_ns, delays[:, 0], delays[:, 1])
    sounds = np.abs(here.seen_ns[:, None] - delays[:, 0]).min(1) <= WINDOW * NS / SAMPLE_RATE
    heard = ((here.seen_ns - origin_ns) / 1e6 - delay) * FPS / 1e3 - 1 + start  # as a tick
    found: list[float] = []
    for second in np.unique(here.seen_ns // NS):
        rows = np.flatnonzero((here.seen_ns // NS == second) & sounds)
        stalled = np.abs(stalls_ns - (second + 0.5) * NS) < NS / 2 + WINDOW * NS / SAMPLE_RATE
        if len(rows) < FPS // 2 or stalled.any():
            continue
        misses = np.array(
            [
                np.sum((here.seen[rows] - _between(material, heard[rows] - shift * FPS / 1e3)) ** 2)
                for shift in SHIFTS_MS
            ]
        )
        best = int(misses.argmin())
        if 0 < best < len(SHIFTS_MS) - 1 and misses[best] < CLEAR * np.median(misses):
            found.append(SHIFTS_MS[best] + STEP_MS * _vertex(*misses[best - 1 : best + 2]))
    return np.array(found)


def concealed_share(here: Found, there: Found) -> tuple[float, int]:
    """Share of the packets that were missing when they were due, and how many more were missing
    because one of the two sound cards was served late: no line and no call could have them."""
    late = np.array([*here.report["late_ns"], *there.report["late_ns"]], np.int64).reshape(-1, 2)
    concealed = np.array(here.report["concealed_ns"], np.int64)
    after = concealed[:, None, None] - late
    starved = ((after[:, :, 0] >= 0) & (after[:, :, 1] <= AFTER_LATE_NS)).any(1)
    played = len(here.heard) / PACKET
    return float((~starved).sum() / played), int(starved.sum())


def lips_error_mm(here: Found, there: Found, material: Material) -> float:
    """The farthest that any point of the lips is off in a tick as it was decoded."""
    rows = (here.ticks + there.report["settings"]["start"]) % len(material.expression)
    error = (here.codes - material.expression[rows]) @ material.lips
    return float(np.linalg.norm(error.reshape(-1, 3), axis=1).max(initial=0))


def _middle(heard: NDArray[np.float64], said: NDArray[np.float64]) -> float | None:
    """At which sample of `said` the middle of `heard` [WINDOW] is; None where they are not alike.

    While the delay adapts, sound is faster or slower by up to 2 %: 5 ms within a window, which a
    search at one speed does not find, or finds elsewhere."""
    size = 1 << (len(said) + PART - 1).bit_length()
    said = said[1:] - SHARPEN * said[:-1]
    spectrum = np.fft.rfft(said, size)
    squares = np.concatenate([[0], np.cumsum(said * said)])
    energy = squares[PART - 1 :] - squares[: 1 - PART]
    most, middle = ALIKE, None
    for speed in SPEEDS:
        at = len(heard) / 2 + (np.arange(PART, dtype=np.float64) - PART / 2) / float(speed)
        played = np.interp(at, np.arange(len(heard), dtype=np.float64), heard)
        here = played[1:] - SHARPEN * played[:-1]
        product = np.fft.irfft(spectrum * np.conj(np.fft.rfft(here, size)), size)[: len(energy)]
        alike = product / np.sqrt(np.maximum(energy * (here @ here), 1e-9))
        best = int(alike.argmax())
        if alike[best] > most and 0 < best < len(alike) - 1:
            most = float(alike[best])
            middle = best + PART / 2 + _vertex(*alike[best - 1 : best + 2])
    return middle


def _between(material: Material, ticks: NDArray[np.float64]) -> NDArray[np.float64]:
    """[n, 256] of the other's face at `ticks`, between whole ones too."""
    whole = np.floor(ticks).astype(int)
    share = (ticks - whole)[:, None]
    codes = material.expression
    return (1 - share) * codes[whole % len(codes)] + share * codes[(whole + 1) % len(codes)]


def _vertex(left: float, middle: float, right: float) -> float:
    """Where between -1 and 1 the parabola through three values has its extreme."""
    return 0.5 * (left - right) / (left - 2 * middle + right + 1e-12)
