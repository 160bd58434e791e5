"""The Sink protocol and the values it receives."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from encoder.types import DrivenFrame
from sensors.types import InputError, SensorFrame


@dataclass(frozen=True)
class RunInfo:
    """Known before the first frame."""

    width: int  # px of the pictures
    height: int
    frames: int | None  # how many will come, where that is known


@dataclass(frozen=True)
class FrameResult:
    """One tick's outcome; `picture` is valid only during `on_frame`."""

    sensors: SensorFrame
    driven: DrivenFrame
    picture: NDArray[np.uint8] | None  # [H, W, 4]; None where the draw was skipped
    dropped: int = 0  # ticks stepped and not drawn, so far
    code_ns: int = 0  # when the code existed, on the run's clock


class Sink(Protocol):
    """Consumes results in order. `close` is called once, after the last frame or a failure."""

    def on_start(self, info: RunInfo) -> None: ...
    def on_frame(self, result: FrameResult) -> None: ...
    def close(self) -> None: ...


class Expendable:
    """A sink that a live run can lose: a full disk, or a folder that is gone, ends the file, not
    the run. Told on stderr."""

    def __init__(self, sink: Sink, path: Path | None = None) -> None:
        self.sink, self.path = sink, path
        self.lost = False

    def on_start(self, info: RunInfo) -> None:
        self.sink.on_start(info)

    def on_frame(self, result: FrameResult) -> None:
        if not self.lost:
            try:
                self.sink.on_frame(result)
            except (OSError, InputError) as error:
                self._lose(error)

    def close(self) -> None:
        try:
            self.sink.close()
        except (OSError, InputError) as error:
            if not self.lost:
                self._lose(error)

    def _lose(self, error: OSError | InputError) -> None:
        self.lost = True
        what = type(self.sink).__name__.removesuffix("Sink").lower()
        told = getattr(error, "strerror", None) or error
        cure = "; free some space" if isinstance(error, OSError) else ""
        print(f"livedrive: {what}: {told}; it ends here, the run goes on{cure}", file=sys.stderr)
