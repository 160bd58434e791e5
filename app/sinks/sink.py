"""The Sink protocol and the values it receives."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from encoder.driver import DrivenFrame
from sensors.types import SensorFrame


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
