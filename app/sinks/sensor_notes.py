"""Says once on stderr when a sensor fails and when it is back, where no dashboard shows it."""

import sys
from collections.abc import Callable

from app.drive.sink import FrameResult, RunInfo
from sensors.live.source import LiveSource
from sensors.types import NS

PATIENCE_NS = 2 * NS  # a sensor may take that long to open


class SensorNotes:
    """A sink; `check` serves loops without frames. What lasts for two seconds is told."""

    def __init__(self, source: LiveSource, tell: Callable[[str], None]) -> None:
        self._source, self._tell = source, tell
        self._since_ns: dict[str, int] = {}  # failing sensors
        self._told: set[str] = set()

    def on_start(self, info: RunInfo) -> None:
        pass

    def on_frame(self, result: FrameResult) -> None:
        self.check(result.driven.t_ns)

    def close(self) -> None:
        """What failed to the end is told, however short the run was."""
        for name, problem in self._problems():
            if problem and name not in self._told:
                self._tell(f"{name}: {problem}")

    def check(self, now_ns: int) -> None:
        for name, problem in self._problems():
            if not problem:
                self._since_ns.pop(name, None)
                if name in self._told:
                    self._told.discard(name)
                    self._tell(f"{name}: is back")
                continue
            lasting = now_ns - self._since_ns.setdefault(name, now_ns) > PATIENCE_NS
            if lasting and name not in self._told:
                self._told.add(name)
                self._tell(f"{name}: {problem}; still looking for it")

    def _problems(self) -> list[tuple[str, str]]:
        found: list[tuple[str, str]] = []
        if self._source.microphone is not None:
            found.append(("microphone", self._source.microphone.problem))
        if self._source.head is not None:
            found.append((self._source.head.name, self._source.head.problem))
        return found + [(camera.name, camera.problem) for camera in self._source.cameras]


def is_needed() -> bool:
    """Is there no terminal on which the dashboard would show it?"""
    return not sys.stdout.isatty()
