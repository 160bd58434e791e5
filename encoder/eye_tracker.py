"""EyeTracker: eyes that are there whatever the cameras do, and never jump.

Where: EyeReading -> EyeTracker -> condition e [160], gaze and lids -> denoiser and decoder. Each
eye follows its own camera; when that is lost it holds for 200 ms, then follows the other eye, and
when both are lost a walk of the gaze graph. Every change of source is a short fade from what was
shown last. The features of borrowed and of synthesised eyes come from the encoder's own map from
gaze and lid to features, so one checkpoint of the denoiser knows all of them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from encoder.eye_calibration import EyeCalibration
from encoder.eye_encoder import EyeEncoder, EyeReading, joined
from encoder.gaze_walk import GazeWalk, WalkState
from sensors.types import FPS

Array = NDArray[np.float32]
OWN, OTHER, WALK = 0, 1, 2  # where an eye comes from
SOURCES = ("camera", "other eye", "synthesised")
HOLD_FRAMES = FPS // 5  # 200 ms
FADE_FRAMES = 6  # from one source to the next; back within 300 ms
GOOD_SCORE = 0.5
# A shut eye is hard to tell from no eye: what was good lately and now looks shut is a blink.
BLINK_FRAMES, BLINK_LID = FPS // 2, 0.5
FASTEST = 0.313  # chord of 18 degrees, more than eyes turn in a frame: a misreading after a blink
SHUT, OPEN = 0.12, 0.35  # lid openings: below, gaze is not seen; above, it is


class Seen(NamedTuple):
    """Both eyes as the head shall show them, left first."""

    features: Array  # [2, 80]
    gaze: Array  # [2, 3] unit
    lids: Array  # [2]


@dataclass(frozen=True, eq=False)
class EyeState:
    """A value."""

    walk: WalkState
    shown: Seen | None  # of the last frame; None before the first
    faded: Seen | None  # where the running fades began
    calibration: EyeCalibration | None = None  # of the person
    source: tuple[int, int] = (WALK, WALK)
    lost: tuple[int, int] = (HOLD_FRAMES, HOLD_FRAMES)  # frames since the own camera was good
    fade: tuple[int, int] = (FADE_FRAMES, FADE_FRAMES)  # frames since the source changed
    trust: tuple[int, int] = (0, 0)  # frames for which a doubtful shut eye still is one
    walking: bool = False


class EyeTracker:
    """step(reading, fresh, state) -> Seen; holds weights only."""

    def __init__(self, encoder: EyeEncoder, walk: GazeWalk) -> None:
        self.encoder, self.walk = encoder, walk

    def init_state(self, calibration: EyeCalibration | None = None) -> EyeState:
        return EyeState(self.walk.init_state(), None, None, calibration)

    def recentred(self, state: EyeState) -> EyeState:
        """What a camera shows now is straight ahead; unchanged while no camera sees an eye."""
        if state.shown is None or 0 not in state.lost:
            return state
        calibration = (state.calibration or EyeCalibration()).recentred(state.shown.gaze)
        return replace(state, calibration=calibration)

    def step(
        self,
        reading: EyeReading | None,  # None: no camera has delivered anything
        fresh: NDArray[np.bool_],  # [2] the picture is new enough
        state: EyeState,
    ) -> tuple[Seen, EyeState]:
        good, trust = _good(reading, fresh, state.trust)
        own = None
        if reading is not None and good.any():
            own = self._own(reading, good, state.calibration)
        lost = tuple(0 if good[e] else min(state.lost[e] + 1, HOLD_FRAMES + 1) for e in (0, 1))
        first = state.shown is None
        source = tuple(_source(e, good, lost, state.source, first) for e in (0, 1))
        walked, state = self._walked(WALK in source, state)
        parts: list[Seen] = []
        fade, faded = list(state.fade), state.faded
        for eye in (0, 1):
            changed = source[eye] != state.source[eye]
            # an eye that comes back from a hold has not changed its source, but has to fade, too
            back = source[eye] == OWN and good[eye] and state.lost[eye] > 0
            # this eye's gaze is of both while both are seen
            other = good[eye] and good[1 - eye] != (state.lost[1 - eye] == 0)
            if (changed or back or other) and not first:
                fade[eye], faded = 0, _put(faded, state.shown, eye)
            parts.append(self._target(eye, source[eye], bool(good[eye]), own, walked, state))
        seen = Seen(*(np.stack(rows) for rows in zip(*parts, strict=True)))
        if faded is not None and min(fade) < FADE_FRAMES:
            seen = _faded(faded, seen, fade)
        if state.shown is not None:
            seen = seen._replace(gaze=_limited(state.shown.gaze, seen.gaze))
        fade = [min(f + 1, FADE_FRAMES) for f in fade]
        after = replace(
            state,
            shown=seen,
            faded=faded,
            source=source,
            lost=lost,
            fade=(fade[0], fade[1]),
            trust=trust,
        )
        return seen, after

    def _own(
        self, reading: EyeReading, good: NDArray[np.bool_], calibration: EyeCalibration | None
    ) -> Seen:
        """The person's own gaze and lids, of the eyes that are seen; the features move along."""
        features, gaze, lids = reading.features, reading.told(good), reading.lids
        if calibration is not None:
            before = self.encoder.synthesise(gaze, lids)
            gaze, lids = calibration.apply(gaze, reading.relative, lids)
            moved = (self.encoder.synthesise(gaze, lids) - before).astype(np.float32)
            features = _bounded(features + moved)
        return Seen(features, joined(gaze, reading.lids, reading.score * good), lids)

    def _walked(self, needed: bool, state: EyeState) -> tuple[Seen | None, EyeState]:
        """The next frame of synthesised eyes, begun where the eyes look now."""
        if not needed:
            return None, replace(state, walking=False)
        walk = state.walk
        if not state.walking and state.shown is not None:
            walk = self.walk.near(state.shown.gaze, walk)
        gaze, lid, walk = self.walk.step(walk)
        lids = np.full(2, lid, np.float32)
        walked = Seen(self.encoder.synthesise(gaze, lids), gaze, lids)
        return walked, replace(state, walk=walk, walking=True)

    def _target(
        self, eye: int, source: int, good: bool, own: Seen | None, walked: Seen | None,
        state: EyeState,
    ) -> Seen:  # fmt: skip
        """One eye's features, gaze and lid from its source."""
        shown = state.shown
        if source == WALK and walked is not None:
            return Seen(walked.features[eye], walked.gaze[eye], walked.lids[eye])
        if source == OTHER and own is not None:
            there = Seen(own.features[1 - eye], own.gaze[1 - eye], own.lids[1 - eye])
            gaze = np.stack([there.gaze, there.gaze])
            average = self.encoder.synthesise(gaze, np.stack([there.lids, there.lids]))
            # features are of left-like eyes: what looks out here looks in over there
            features = _bounded(there.features + average[eye] - average[1 - eye])
            here = Seen(features, there.gaze, there.lids)
        elif good and own is not None:
            here = Seen(own.features[eye], own.gaze[eye], own.lids[eye])
        else:  # hold
            assert shown is not None
            return Seen(shown.features[eye], shown.gaze[eye], shown.lids[eye])
        sight = np.float32(np.clip((here.lids - SHUT) / (OPEN - SHUT), 0, 1))
        if shown is None or sight == 1:
            return here
        return here._replace(gaze=_turn(shown.gaze[eye], here.gaze, sight))


def _good(
    reading: EyeReading | None, fresh: NDArray[np.bool_], trust: tuple[int, int]
) -> tuple[NDArray[np.bool_], tuple[int, int]]:
    """Which eyes are seen [2], and the trust that is left."""
    if reading is None:
        return np.zeros(2, np.bool_), (0, 0)
    sure = fresh & (reading.score >= GOOD_SCORE)
    shut = fresh & (reading.score > 0) & (reading.lids < BLINK_LID) & (np.array(trust) > 0)
    left = [BLINK_FRAMES if sure[e] else max(trust[e] - 1, 0) for e in (0, 1)]
    return sure | shut, (left[0], left[1])


def _source(
    eye: int, good: NDArray[np.bool_], lost: tuple[int, ...], before: tuple[int, int], first: bool
) -> int:
    if good[eye]:
        return OWN
    if before[eye] == OWN and lost[eye] <= HOLD_FRAMES and not first:
        return OWN  # held
    if good[1 - eye]:
        return OTHER
    # the other eye may be in its hold: then this one waits with it
    waits = before[eye] != WALK and before[1 - eye] == OWN and lost[1 - eye] <= HOLD_FRAMES
    return OWN if waits and not first else WALK


def _bounded(features: Array) -> Array:
    return np.clip(features, np.float32(-1), np.float32(1))


def _turn(start: Array, end: Array, weight: np.float32) -> Array:
    gaze = start + weight * (end - start)
    return (gaze / np.linalg.norm(gaze)).astype(np.float32)


def _limited(before: Array, after: Array) -> Array:
    """[2, 3] at most FASTEST away from the frame before."""
    chord = np.linalg.norm(after - before, axis=-1, keepdims=True)
    share = FASTEST / np.maximum(chord, FASTEST)
    near = before + share * (after - before)
    near = near / np.linalg.norm(near, axis=-1, keepdims=True)
    return np.where(chord > FASTEST, near, after).astype(np.float32)


def _put(faded: Seen | None, shown: Seen | None, eye: int) -> Seen | None:
    """`faded` with one eye as it is shown now."""
    if faded is None or shown is None:
        return shown
    mixed = [old.copy() for old in faded]
    for new, now in zip(mixed, shown, strict=True):
        new[eye] = now[eye]
    return Seen(*mixed)


def _faded(start: Seen, end: Seen, frames: list[int]) -> Seen:
    """Between two, as far as each eye's fade has come; at the end exactly `end`."""
    done = (np.array(frames, np.float32) + 1) / (FADE_FRAMES + 1)
    weight = (done * done * (3 - 2 * done)).astype(np.float32)
    fading = np.array(frames) < FADE_FRAMES
    mixed = [
        a + weight.reshape(-1, *[1] * (a.ndim - 1)) * (b - a)
        for a, b in zip(start, end, strict=True)
    ]
    mixed[1] = mixed[1] / np.linalg.norm(mixed[1], axis=-1, keepdims=True)
    kept = [
        np.where(fading.reshape(-1, *[1] * (b.ndim - 1)), m, b).astype(np.float32)
        for m, b in zip(mixed, end, strict=True)
    ]
    return Seen(*kept)
