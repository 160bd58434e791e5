"""The Driver: one SensorFrame in, one DrivenFrame out, nothing of the future (paper section 4.3).

1600 new samples -> audio features; eye pictures -> condition e and gaze, or a walk of the gaze
graph -> one denoising step at tau = N, with noise keyed by (seed, frame index) and the past as a
K/V cache. Between assembly and the decoder in the flow.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from encoder.alive.alive import Alive, AliveState, Moved
from encoder.alive.face import evened
from encoder.emotion.control import NEUTRAL, Emotions
from encoder.eyes.gaze_graph import GazeGraph
from encoder.eyes.gaze_walk import GazeWalk, WalkState
from encoder.eyes.tracker import EyeState, EyeTracker, eyes_in
from encoder.nn import philox
from encoder.types import DrivenFrame, DriverState, Floats, Mood
from sensors.threads import Threads
from sensors.types import InputError, SensorFrame

if TYPE_CHECKING:
    from encoder.backends import Backend
    from encoder.denoiser.config import DenoiserConfig
    from encoder.eyes.calibration import EyeCalibration
    from encoder.eyes.encoder import EyeEncoder
    from encoder.eyes.framing import Framed

Timer = Callable[[str], AbstractContextManager[object]]
# The denoiser's condition, gaze [2, 3], the state after it, DrivenFrame.eye_frames.
Looked = tuple[Floats, Floats, "WalkState | EyeState", Floats | None]


def frame_noise(seed: int, index: int, dim: int) -> Floats:
    """Gaussian noise [dim] of one frame, a function of (seed, frame index) and nothing else."""
    return philox.generator(seed, 0, 0, 0, index).standard_normal(dim, dtype=np.float32)


def _untimed(stage: str) -> AbstractContextManager[object]:
    return nullcontext()


class Driver:
    """Holds weights only; every stream's memory is in its state."""

    def __init__(
        self,
        backend: Backend[Any],
        config: DenoiserConfig,  # of the backend's denoiser
        mean: Floats,  # [256] of the codes, in which the denoiser is standardised
        std: Floats,  # [256]
        eyes: EyeEncoder | None = None,
        graph: GazeGraph | None = None,  # default: the shipped one
        emotions: Emotions | None = None,  # of this denoiser
        calibration: EyeCalibration | None = None,  # of who wears the headset
        alive: Alive | None = None,  # None: the head is still, and only speech and eyes move it
    ) -> None:
        if (config.condition == "eyes") != (eyes is not None):
            raise InputError(
                f"student: expected a model conditioned on {'eyes' if eyes else 'gaze'}, got "
                f"{config.condition!r}; run with --condition {config.condition}"
            )
        self.backend, self.config, self.eyes = backend, config, eyes
        self.mean, self.std = mean, std
        self.graph = graph or GazeGraph.load()
        self.emotions, self.calibration, self.alive = emotions, calibration, alive
        self._threads = Threads()

    def init_state(self, seed: int) -> DriverState:
        walk = GazeWalk(self.graph, seed)
        gaze = self._tracker(seed).init_state(self.calibration) if self.eyes else walk.init_state()
        alive = self.alive.init_state() if self.alive else None
        return DriverState(seed, self.backend.init_state(), gaze, alive=alive)

    def recentred(self, state: DriverState) -> DriverState:
        """Where the tracked eyes look now is straight ahead from now on, and where the head is, is
        its centre."""
        if self.alive and isinstance(state.alive, AliveState):
            state = replace(state, alive=self.alive.recentred(state.alive))
        if isinstance(state.gaze, EyeState):
            return replace(state, gaze=self._tracker(state.seed).recentred(state.gaze))
        return state

    def step(
        self, frame: SensorFrame, state: DriverState, timer: Timer = _untimed
    ) -> tuple[DrivenFrame, DriverState]:
        """A gap in the sound is driven as the zeros it holds; time goes on and nothing is reset
        but what the frame asks for."""
        for wanted in frame.requests:
            state = self.recentred(state) if wanted == "recentre" else self.init_state(state.seed)
        listen = partial(self._listen, frame, state, timer)
        if isinstance(state.gaze, EyeState):
            framed = self._framed(frame, state.gaze, timer)
            look = partial(self._look, frame, state.gaze, framed, state.seed, timer)
            heard, looked = self._threads.both(listen, look)
        else:
            assert isinstance(state.gaze, WalkState)
            heard, looked = listen(), self._walk(frame, state.gaze, state.seed, timer)
        features, backend_state, noise, moved = heard
        condition, gaze, gaze_state, eye_frames = looked
        with timer("denoise"):
            emotion, mood = self._emotion(frame.emotion, state.mood)
            code, backend_state = self.backend.denoise(
                noise, features, condition, backend_state, emotion
            )
            expression = code * self.std + self.mean
            after = DriverState(state.seed, backend_state, gaze_state, mood)
            if self.alive is None:
                driven = DrivenFrame(frame.index, frame.t_ns, expression, gaze)
                return replace(driven, eye_frames=eye_frames), after
            assert isinstance(state.alive, AliveState)
            if self.eyes is None:  # no camera sees the lids
                expression = evened(expression, self.alive.shapes)
            made = isinstance(state.gaze, WalkState) and frame.gaze is None
            shown, alive = self.alive.step(
                frame, expression, gaze, made, state.seed, state.alive, moved
            )
        driven = DrivenFrame(frame.index, frame.t_ns, **vars(shown), eye_frames=eye_frames)
        return driven, replace(after, alive=alive)

    def close(self) -> None:
        """End the thread that looks while the driver listens; it may be stepped again."""
        self._threads.close()

    def check_emotion(self, words: str) -> None:
        """Raise InputError where `words` cannot be shown."""
        if self.emotions is not None:
            self.emotions.check(words)
        elif words not in ("", NEUTRAL):
            raise InputError(
                f"emotion: expected weights made for this {self.config.condition} model, got none "
                f"for {words!r}; run `livedrive train emotion`, or go on with --emotion {NEUTRAL}"
            )

    def _emotion(self, words: str, mood: Mood) -> tuple[Floats | None, Mood]:
        if self.emotions is None:
            self.check_emotion(words)
            return None, mood
        return self.emotions.step(words, mood)

    def _listen(
        self, frame: SensorFrame, state: DriverState, timer: Timer
    ) -> tuple[Floats, Any, Floats, Moved | None]:
        """The audio features [A], the backend's state after them; the noise [256] and, where
        gaze is measured, how the head moves, which need not wait for the eyes either."""
        with timer("audio"):
            noise = frame_noise(state.seed, frame.index, self.config.expression_dim)
            moved = None
            if self.alive and isinstance(state.alive, AliveState) and self.eyes:
                moved = self.alive.move(frame, None, state.seed, state.alive)
            return *self.backend.audio(frame.audio, state.backend), noise, moved

    def _framed(self, frame: SensorFrame, state: EyeState, timer: Timer) -> Framed | None:
        """The pictures of the eyes, made ready here: it is Python's work, and listening begins with
        the same, so that threads would only wait for each other."""
        assert self.eyes is not None
        with timer("eyes"):
            if frame.eyes is None or not frame.eyes_valid.any():
                return None
            return self.eyes.framing.framed(frame.eyes, state.encoder.framing)

    def _look(
        self, frame: SensorFrame, state: EyeState, framed: Framed | None, seed: int, timer: Timer
    ) -> Looked:
        assert self.eyes is not None
        with timer("gaze"):
            reading = None
            if framed:
                reading, seen_by = self.eyes.read(framed, state.encoder)
                state = replace(state, encoder=seen_by)
            seen, state = self._tracker(seed).step(reading, frame.eyes_valid, state)
            return seen.features.reshape(-1), seen.gaze, state, eyes_in(state)

    def _walk(self, frame: SensorFrame, state: WalkState, seed: int, timer: Timer) -> Looked:
        with timer("gaze"):
            walker = GazeWalk(self.graph, seed)
            if frame.gaze is not None:  # a headset says where the eyes look
                gaze = np.array([frame.gaze] * 2, np.float32)
                return gaze.reshape(-1), gaze, walker.near(gaze, state), None
            gaze, _, walk = walker.step(state)
            return gaze.reshape(-1), gaze, walk, None

    def _tracker(self, seed: int) -> EyeTracker:
        assert self.eyes is not None
        return EyeTracker(self.eyes, GazeWalk(self.graph, seed))
