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
from app.call.trial.track import WINDOW, Matches, jumps, matches, track, vertex
from sensors.types import FPS, NS, SAMPLE_RATE, SAMPLES_PER_FRAME

SEARCH = SAMPLE_RATE // 2  # samples later than it was said at most
STEP_MS = 2.0
SHIFTS_MS = np.arange(-120, 120 + STEP_MS, STEP_MS)  # of the face that are tried
INSIDE = 0.51  # of a window, around its middle
CLEAR = 0.5  # of the median miss: a face that hardly moves fits everywhere and tells no time
AFTER_LATE_NS = NS // 4  # in which a packet that was sent late would have been due


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
    windows: list[Matches] = []
    for at in range(0, len(here.heard) - WINDOW + 1, WINDOW):
        heard_ns = first_ns + at * 1e9 / SAMPLE_RATE
        said_by_now = round((heard_ns - origin_ns) * SAMPLE_RATE / 1e9)
        first = said_by_now - SEARCH + start
        reach = (first + np.arange(SEARCH + WINDOW, dtype=np.int64)) % len(material.sound)
        said = material.sound[reach].astype(np.float64)
        middles, alike = matches(here.heard[at : at + WINDOW].astype(np.float64), said)
        if len(middles):
            late_ms = (SEARCH + WINDOW / 2 - middles) * 1e3 / SAMPLE_RATE
            windows.append(Matches(heard_ns + WINDOW / 2 * 1e9 / SAMPLE_RATE, late_ms, alike))
    return track(windows)


def lips_ms(
    here: Found, there: Found, material: Material, delays: NDArray[np.float64]
) -> NDArray[np.float64]:
    """[n] for each second in which the face moves: how much later it is than the sound, in ms.

    It is the shift by which the poses of that second fit best what the other's face did. Where no
    sound is found there is nothing that the face could be early or late to: in silence, and while
    the machine stalls (`stalled_ms` of the report), when the card plays nothing. Where the sound
    jumps, what is heard between two windows is not known.
    """
    if not len(delays):
        return np.zeros(0)
    origin_ns, start = there.report["origin_ns"], there.report["settings"]["start"]
    stalls_ns = np.array(here.report["stalls_ns"], np.int64)
    delay = np.interp(here.seen_ns, delays[:, 0], delays[:, 1])
    sounds = _found(here.seen_ns, delays)
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
            found.append(SHIFTS_MS[best] + STEP_MS * vertex(*misses[best - 1 : best + 2]))
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


def _found(t_ns: NDArray[np.int64], delays: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether the moment lies in a window that was found, and not where the sound jumped."""
    inside = np.abs(t_ns[:, None] - delays[:, 0]).min(1) <= INSIDE * WINDOW * NS / SAMPLE_RATE
    jumped = jumps(np.diff(delays[:, 1]), np.diff(delays[:, 0]))
    following = np.searchsorted(delays[:, 0], t_ns)
    return inside & ~np.concatenate([[False], jumped, [False]])[following]


def _between(material: Material, ticks: NDArray[np.float64]) -> NDArray[np.float64]:
    """[n, 256] of the other's face at `ticks`, between whole ones too."""
    whole = np.floor(ticks).astype(int)
    share = (ticks - whole)[:, None]
    codes = material.expression
    return (1 - share) * codes[whole % len(codes)] + share * codes[(whole + 1) % len(codes)]
