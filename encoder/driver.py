"""The Driver: one SensorFrame in, one DrivenFrame out, nothing of the future (paper section 4.3).

1600 new samples -> audio features; eye pictures -> condition e and gaze, or a walk of the gaze
graph -> one denoising step at tau = N, with noise keyed by (seed, frame index) and the past as a
K/V cache. Between assembly and the decoder in the flow.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from encoder.diffusion import frame_noise
from encoder.emotion import NEUTRAL, Emotions, Mood
from encoder.eye_tracker import EyeState, EyeTracker
from encoder.gaze_graph import GazeGraph
from encoder.gaze_walk import GazeWalk, WalkState
from sensors.types import InputError, SensorFrame

if TYPE_CHECKING:
    from encoder.backends import Backend, BackendState
    from encoder.denoiser import Denoiser
    from encoder.eye_calibration import EyeCalibration
    from encoder.eye_encoder import EyeEncoder

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
    gaze: WalkState | EyeState  # as the condition is
    mood: Mood = Mood()


def _untimed(stage: str) -> AbstractContextManager[object]:
    return nullcontext()


class Driver:
    """Holds weights only; every stream's memory is in its state."""

    def __init__(
        self,
        backend: Backend,
        denoiser: Denoiser,
        eyes: EyeEncoder | None = None,
        graph: GazeGraph | None = None,  # default: the shipped one
        emotions: Emotions | None = None,  # of this denoiser
    ) -> None:
        config = denoiser.config
        if (config.condition == "eyes") != (eyes is not None):
            raise InputError(
                f"student: expected a model conditioned on {'eyes' if eyes else 'gaze'}, got "
                f"{config.condition!r}; run with --condition {config.condition}"
            )
        self.backend, self.config, self.eyes = backend, config, eyes
        self.graph = graph or GazeGraph.load()
        self.emotions = emotions
        self.calibration: EyeCalibration | None = None  # of who wears the headset
        self.mean = denoiser.expression_mean.cpu().numpy()
        self.std = denoiser.expression_std.cpu().numpy()

    def init_state(self, seed: int) -> DriverState:
        walk = GazeWalk(self.graph, seed)
        gaze = self._tracker(seed).init_state(self.calibration) if self.eyes else walk.init_state()
        return DriverState(seed, self.backend.init_state(), gaze)

    def recentred(self, state: DriverState) -> DriverState:
        """Where the tracked eyes look now is straight ahead from now on."""
        if isinstance(state.gaze, EyeState):
            return replace(state, gaze=self._tracker(state.seed).recentred(state.gaze))
        return state

    def step(
        self, frame: SensorFrame, state: DriverState, timer: Timer = _untimed
    ) -> tuple[DrivenFrame, DriverState]:
        """A gap in the sound is driven as the zeros it holds; time goes on and nothing is reset."""
        with timer("audio"):
            features, backend_state = self.backend.audio(frame.audio, state.backend)
        condition, gaze, gaze_state = self._look(frame, state, timer)
        with timer("denoise"):
            noise = frame_noise(state.seed, frame.index, self.config.expression_dim)
            felt, mood = self._feel(frame.emotion, state.mood)
            code, backend_state = self.backend.denoise(
                noise, features, condition, backend_state, felt
            )
            expression = code * self.std + self.mean
        driven = DrivenFrame(frame.index, frame.t_ns, expression, gaze)
        return driven, DriverState(state.seed, backend_state, gaze_state, mood)

    def check_emotion(self, words: str) -> None:
        """Raise InputError where `words` cannot be shown."""
        if self.emotions is not None:
            self.emotions.mixture(words)
        elif words not in ("", NEUTRAL):
            raise InputError(
                f"emotion: expected weights made for this {self.config.condition} model, got none "
                f"for {words!r}; run `livedrive train emotion`, or go on with --emotion {NEUTRAL}"
            )

    def _feel(self, words: str, mood: Mood) -> tuple[NDArray[np.float32] | None, Mood]:
        if self.emotions is None:
            self.check_emotion(words)
            return None, mood
        return self.emotions.step(words, mood)

    def _look(
        self, frame: SensorFrame, state: DriverState, timer: Timer
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], WalkState | EyeState]:
        """The denoiser's condition, gaze [2, 3], and the state after it."""
        if isinstance(state.gaze, WalkState):
            with timer("gaze"):
                gaze, _, walk = GazeWalk(self.graph, state.seed).step(state.gaze)
            return gaze.reshape(-1), gaze, walk
        assert self.eyes is not None
        with timer("eyes"):
            visible = frame.eyes is not None and frame.eyes_valid.any()
            reading = self.eyes(frame.eyes) if visible else None  # type: ignore[arg-type]
        with timer("gaze"):
            tracker = self._tracker(state.seed)
            seen, eye_state = tracker.step(reading, frame.eyes_valid, state.gaze)
        return seen.features.reshape(-1), seen.gaze, eye_state

    def _tracker(self, seed: int) -> EyeTracker:
        assert self.eyes is not None
        return EyeTracker(self.eyes, GazeWalk(self.graph, seed))
