"""The table of a Live Link Face take (an iPhone's CSV): each reader asks for its columns.

`Timecode, BlendShapeCount`, 52 blendshapes, then angles of head and eyes in rad. A row without a
face has the count 0.
"""

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sensors.types import InputError

WEIGHTS = (-0.5, 1.5)  # limits of blendshapes: trackers overshoot 0..1 a little
COUNT = "blendshapecount"  # of a row; 0: no face
TONGUE = "TongueOut"  # that older phones do not know
_TIMECODE = re.compile(r"(\d+):(\d+):(\d+)[:;](\d+)(\.\d+)?")
_RATES = (24, 25, 30, 60)  # timecodes a second
_SURE = 60  # rows: fewer need not reach a second's last number, and count as a phone's own rates
_DAY_S = 86_400.0


@dataclass(frozen=True)
class LivelinkTable:
    """The rows with a face."""

    times: NDArray[np.float64]  # [N] seconds since the first, also over midnight; they may fall
    values: NDArray[np.float64]  # [N, K] in the order of the columns asked for
    lines: list[int]  # [N] where in the file


def read(
    path: Path,
    columns: Sequence[str],  # the first letter of a name may be small, here and in the file
    limits: tuple[float, float] | None = None,  # None: NaN is taken, too
) -> LivelinkTable:
    """Raises InputError where it is no such table, lacks a column but TONGUE (which counts as 0),
    or holds something else than numbers within the limits."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file)
            header = [_pascal(name) for name in next(reader, list[str]())]
            rows = [(reader.line_num, row) for row in reader if row]
    except (UnicodeDecodeError, csv.Error) as error:
        raise _no_table(path, str(error)) from None
    names = [_pascal(name) for name in columns]
    missing = [name for name in ("Timecode", *names) if name not in (*header, TONGUE)]
    if missing:
        more = " and more" if len(missing) > 5 else ""
        raise _no_table(path, f"no {', '.join(missing[:5])}{more}")
    time, places = header.index("Timecode"), [header.index(n) if n in header else -1 for n in names]
    lower = [name.lower() for name in header]  # Blendshape in some versions, BlendShape in others
    count = lower.index(COUNT) if COUNT in lower else len(header)
    stamps, values, lines = list[tuple[float, float]](), list[list[float]](), list[int]()
    for number, row in rows:
        if row[count : count + 1] == ["0"]:
            continue
        try:
            stamps.append(_stamp(row[time]))
            values.append([_number(row[k], limits) if k >= 0 else 0.0 for k in places])
        except (ValueError, IndexError) as error:
            got = f"{len(row)} columns" if isinstance(error, IndexError) else repr(str(error))
            wanted = f"numbers from {limits[0]} to {limits[1]}" if limits else "numbers"
            raise InputError(
                f"{path}: line {number}: expected a timecode and {len(names)} {wanted}, got {got}; "
                "repair or delete that line"
            ) from None
        lines.append(number)
    return LivelinkTable(_times(stamps), np.array(values).reshape(-1, len(names)), lines)


def _times(stamps: list[tuple[float, float]]) -> NDArray[np.float64]:
    seconds, frames = np.array(stamps).reshape(-1, 2).T
    highest = int(frames.max(initial=0))
    rates = _RATES if len(frames) > _SURE else (30, 60)
    times = seconds + frames / next((rate for rate in rates if rate > highest), highest + 1)
    first = times[:1]
    return times + _DAY_S * (first - times > _DAY_S / 2) - first


def _stamp(text: str) -> tuple[float, float]:
    """Seconds of the day, frames in the second."""
    found = _TIMECODE.fullmatch(text.strip())
    if found is None:
        raise ValueError(text)
    hours, minutes, seconds, frame = map(int, found.groups()[:4])
    return 3600.0 * hours + 60 * minutes + seconds, frame + float(found[5] or 0)


def _number(text: str, limits: tuple[float, float] | None) -> float:
    try:
        value = float(text)
    except ValueError:
        raise ValueError(text) from None
    if limits and not limits[0] <= value <= limits[1]:
        raise ValueError(text)
    return value


def _pascal(name: str) -> str:
    return name[:1].upper() + name[1:]


def _no_table(path: Path, got: str) -> InputError:
    return InputError(
        f"{path}: expected a table of Live Link Face, got {got}; record in ARKit mode, and export "
        "the take as CSV again"
    )
