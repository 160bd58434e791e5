"""What `bench soak` watches: the codes, memory, descriptors and time, after the warm-up."""

import hashlib
import os
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from app.drive.sink import FrameResult, RunInfo
from sensors.types import FPS, NS

if TYPE_CHECKING:
    import psutil

WARM_UP_S = 60.0  # at most; buffers are touched, the envelope of the clock settles


class SoakProbe:
    """A sink: a digest of every frame, and what grows."""

    def __init__(self, seconds: float) -> None:
        import psutil

        self.digests = np.ones(int(seconds * FPS) + 10 * FPS, np.uint64)
        self.frames = self.gaps = self.warm_dropped = 0
        self._process = psutil.Process(os.getpid())
        self.warm = int(min(WARM_UP_S, seconds / 2) * FPS)
        self._start: dict[str, float] = {}
        self._start_ns = 0
        self.growth: dict[str, float] = {}
        self.drift_ms = 0.0

    def on_start(self, info: RunInfo) -> None:
        pass

    def on_frame(self, result: FrameResult) -> None:
        driven = result.driven
        head = np.array([*driven.head.position, *driven.head.quat])
        code = driven.expression.tobytes() + driven.gaze.tobytes() + head.tobytes()
        digest = hashlib.blake2b(code, digest_size=8).digest()
        self.digests[self.frames] = np.frombuffer(digest, np.uint64)[0]
        self.frames += 1
        if self.frames == self.warm:
            self._start, self._start_ns = self._sizes(), result.sensors.t_ns
            self.warm_dropped = result.dropped
        if self.frames > self.warm:
            self.gaps += result.sensors.audio_gap
        if self.frames > self.warm and self.frames % (5 * FPS) == 0:
            now = self._sizes()
            self.growth = {k: round(now[k] - self._start[k], 2) for k in now if k in self._start}
            counted_ns = (self.frames - self.warm) * NS // FPS
            self.drift_ms = (result.sensors.t_ns - self._start_ns - counted_ns) / 1e6

    def close(self) -> None:
        pass

    def _sizes(self) -> dict[str, float]:
        """Of this process, how many it has started that live, and their memory."""
        import psutil

        own = self._process
        sizes = {
            "memory_mb": own.memory_info().rss / 2**20,
            "threads": float(own.num_threads()),
            "descriptors": float(_open_files(own)),
            "children": 0.0,
        }
        for child in own.children():
            try:
                words = child.cmdline()
                sizes[f"{_name(words)}_memory_mb"] = child.memory_info().rss / 2**20
            except psutil.Error:  # it has ended
                continue
            sizes["children"] += 1
        return sizes


def _name(words: Sequence[str]) -> str:
    """What a process of ours is, e.g. app.web."""
    return words[words.index("-m") + 1] if "-m" in words else os.path.basename(words[0])


def unlike(live: SoakProbe, replayed: SoakProbe) -> int:
    """Frames that are not the same in both."""
    frames = max(live.frames, replayed.frames)
    return int((live.digests[:frames] != replayed.digests[:frames]).sum())


def watched_growth(probe: SoakProbe) -> dict[str, Any]:
    """For the report: growth by name since the warm-up."""
    return {f"{name}_growth": value for name, value in sorted(probe.growth.items())}


def _open_files(process: "psutil.Process") -> int:
    if sys.platform == "win32":
        return process.num_handles()
    return process.num_fds()
