"""The live dashboard on the terminal: levels, eyes, ages, drops and a histogram of latencies.

Drawn by rich's own thread four times a second; the loop only leaves numbers behind.
"""

from typing import Any

import numpy as np

from app.drive.sink import FrameResult, RunInfo
from app.sinks.live_stats import CAPACITY, LiveStats
from sensors.live.source import LiveSource
from sensors.types import EYE_NAMES

REFRESH_HZ = 4
SHOWN_FRAMES = 300  # of the histogram: ten seconds
EDGES_MS = (0, 5, 10, 15, 20, 25, 30, 40, 60, 100, 1e9)
BARS = " ▁▂▃▄▅▆▇█"


class Dashboard:
    """A sink that shows, where the output is a terminal; elsewhere it is silent."""

    def __init__(self, source: LiveSource, stats: LiveStats) -> None:
        self._source, self._stats = source, stats
        self._live: Any = None

    def on_start(self, info: RunInfo) -> None:
        from rich.live import Live

        from app.terminal.console import console

        screen = console()
        if screen.is_terminal:
            self._live = Live(
                get_renderable=self.render, console=screen, refresh_per_second=REFRESH_HZ
            )
            self._live.start()

    def on_frame(self, result: FrameResult) -> None:
        pass

    def close(self) -> None:
        if self._live is not None:
            self._live.stop()

    def render(self) -> Any:
        from rich.table import Table

        from app.terminal.console import one_line

        stats, source = self._stats, self._source
        table = Table(title="livedrive, live: Ctrl-C ends it", title_justify="left")
        for heading in ("sensor", "state", "now", "lost"):
            table.add_column(heading)
        microphone = source.microphone
        state = "none" if microphone is None else one_line(microphone.problem) or "live"
        lost = "" if microphone is None else f"{microphone.dropped} samples"
        table.add_row("microphone", state, meter(stats.level_db), lost)
        for camera in source.cameras:
            eyes = " + ".join(EYE_NAMES[eye] for eye in camera.views.eyes)
            counts = (
                f"{camera.counts.damaged} damaged, {max(camera.counts.connects - 1, 0)} reconnects"
            )
            now = " ".join(self._age(eye) for eye in camera.views.eyes)
            state = one_line(camera.problem) or f"live, {camera.counts.pictures} pictures"
            table.add_row(f"eye {eyes}", state, now, counts)
        drops = f"{stats.dropped} ticks not drawn, {stats.gaps} with a gap"
        table.add_row("tick", f"{stats.frames} frames", self._histogram(), drops)
        return table

    def _age(self, eye: int) -> str:
        stats = self._stats
        if not stats.frames or not stats.eyes_valid[eye]:
            return f"{EYE_NAMES[eye]} lost"
        return f"{stats.eye_age_ms[eye, (stats.frames - 1) % CAPACITY]:.0f} ms"

    def _histogram(self) -> str:
        """Sound to code in the last ten seconds: 0-5, 5-10 ... > 100 ms."""
        end = self._stats.frames
        if not end:
            return ""
        slots = np.arange(max(end - SHOWN_FRAMES, 0), end) % CAPACITY
        values = self._stats.latency_ms[slots]
        counts, _ = np.histogram(values, EDGES_MS)
        levels = np.ceil(counts / counts.max() * (len(BARS) - 1)) if counts.any() else counts
        p95 = np.nanpercentile(values, 95)
        return "".join(BARS[int(n)] for n in levels) + f" p95 {p95:.0f} ms"


def meter(level_db: float) -> str:
    """-60..0 dBFS as twenty blocks."""
    full = int(np.clip((level_db + 60) / 3, 0, 20))
    return "█" * full + "·" * (20 - full) + f" {level_db:4.0f} dB"
