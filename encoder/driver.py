"""The Driver: one SensorFrame in, one DrivenFrame out, nothing of the future (paper section 4.3).

1600 new samples -> audio features -> gaze -> one denoising step at tau = N, with noise keyed by
(seed, frame index) and the past as a K/V cache. Between assembly and the decoder in the flow.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from encoder.diffusion import frame_noise
from encoder.gaze import GazeState, GazeSynth
from sensors.types import InputError, SensorFrame

if TYPE_CHECKING:
    from encoder.denoiser import Denoiser
    from encoder.inference import Backend, BackendState

Timer = Callable[[str], AbstractContextManager[object]]


@dataclass(frozen=True, eq=False)
class DrivenFrame:
    index: int
    t_ns: int
    expression: NDArray[np.float32]  # [256] code, not standardised
    gaze: NDArray[np.float32]  # [2, 3] unit, left eye first


@dataclass(frozen=True, eq=False)
class DriverState:
    """A value: everything the next frame depends on, with the seed of its noise."""

    seed: int
    backend: BackendState
    gaze: GazeState


def _untimed(stage: str) -> AbstractContextManager[object]:
    return nullcontext()


class Driver:
    """Holds weights only; every stream's memory is in its state."""

    def __init__(self, backend: Backend, denoiser: Denoiser) -> None:
        config = denoiser.config
        if config.condition != "gaze":
            raise InputError(
                f"student: expected a model conditioned on gaze, got {config.condition!r}; "
                "run with --condition eyes"
            )
        self.backend, self.config = backend, config
        self.mean = denoiser.expression_mean.cpu().numpy()
        self.std = denoiser.expression_std.cpu().numpy()

    def init_state(self, seed: int) -> DriverState:
        return DriverState(seed, self.backend.init_state(), GazeSynth(seed).init_state())

    def step(
        self, frame: SensorFrame, state: DriverState, timer: Timer = _untimed
    ) -> tuple[DrivenFrame, DriverState]:
        """A gap in the sound is driven as the zeros it holds; time goes on and nothing is reset."""
        with timer("audio"):
            features, backend_state = self.backend.audio(frame.audio, state.backend)
        with timer("gaze"):
            gaze, gaze_state = GazeSynth(state.seed).step(state.gaze)
        with timer("denoise"):
            noise = frame_noise(state.seed, frame.index, self.config.expression_dim)
            code, backend_state = self.backend.denoise(
                noise, features, gaze.reshape(-1), backend_state
            )
            expression = code * self.std + self.mean
        driven = DrivenFrame(frame.index, frame.t_ns, expression, gaze)
        return driven, DriverState(state.seed, backend_state, gaze_state)
