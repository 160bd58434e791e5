"""The tick without a headset and with one, by turns: the headset draws in a process of its own.

The headset is the stand-in runtime, which asks for 90 frames a second. Without it the tick draws a
picture, as in `bench tick`. With it the tick draws none, as in `run --xr`, or, with a window beside
the headset, one of its own: thresholds are for both.
"""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from app.bench.xr.frames import SIZE
from app.terminal.thresholds import at_most

ROUNDS = 3  # of a replay each way
WAYS = {"off": "none", "on": "shown in it", "window": "and in a window"}
PARTS = ("tick_p50_ms", "tick_p99_ms", "dropped")
WORST = ("dropped", "crashes")  # of all rounds: nothing of these may be lost in a median


def measure_ticks(session: Path, avatar: str) -> tuple[dict[str, float], list[dict[str, Any]]]:
    """Metrics, each the median of all rounds or the worst of them, and thresholds."""
    from tqdm import tqdm

    from app.terminal.console import console, numbers

    found: dict[str, list[dict[str, float]]] = {way: [] for way in WAYS}
    with TemporaryDirectory() as folder:
        runtime = Path(folder, "runtime")
        runtime.touch()
        for _ in tqdm(range(ROUNDS), unit="round", disable=None):
            found["off"].append(_replay(session, avatar, None, draw=True))
            found["on"].append(_replay(session, avatar, runtime, draw=False))
            found["window"].append(_replay(session, avatar, runtime, draw=True))
    metrics: dict[str, float] = {}
    table = numbers("headset", "tick p50 ms", "p99 ms", "dropped", "its frames a second", "of full")
    for name, rounds in found.items():
        middle = {
            part: float((np.max if part in WORST else np.median)([r[part] for r in rounds]))
            for part in rounds[0]
        }
        metrics |= {f"{name}_{part}": round(value, 3) for part, value in middle.items()}
        cells = [f"{middle[part]:.1f}" for part in PARTS]
        more = [f"{middle['fps']:.0f}", f"{middle['share']:.2f}"] if "fps" in middle else ["", ""]
        table.add_row(WAYS[name], *cells, *more)
    console().print(table)
    thresholds = [
        at_most(f"{way}_{part}", metrics[f"{way}_{part}"], most)
        for way in ("on", "window")
        for part, most in zip((*PARTS, "crashes"), (22.0, 33.0, 0, 0), strict=True)
    ]
    return metrics, thresholds


def _replay(session: Path, avatar: str, runtime: Path | None, *, draw: bool) -> dict[str, float]:
    from app.compose.live import tell
    from app.compose.replay import replay
    from app.compose.settings import DriveSettings
    from app.sinks.progress import ProgressSink
    from app.xr.link import XrInfo
    from app.xr.sink import XrSink
    from sensors.clock import MonotonicClock

    settings, headset = DriveSettings(avatar=avatar, realtime=True, draw=draw), None
    if runtime is not None:
        info = XrInfo("auto", avatar, standin=str(runtime), standin_px=SIZE)
        headset = XrSink(info, MonotonicClock(), tell)
    measured = replay(session, settings, [ProgressSink(), *([headset] if headset else [])])
    tick = measured["stages"]["tick"]
    out = {"tick_p50_ms": tick["p50_ms"], "tick_p99_ms": tick["p99_ms"]}
    out["dropped"] = measured["dropped"]
    if headset is not None:
        shown = headset.xr_report()
        out["fps"], out["share"] = shown["frames"] / measured["seconds"], shown["share"]
        out["crashes"] = shown["crashes"]
    return out
