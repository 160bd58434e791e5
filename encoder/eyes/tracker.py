"""EyeTracker: continuous eyes, whatever the cameras deliver.

Where: EyeReading -> EyeTracker -> condition e [160], gaze and lids -> denoiser and decoder. Each
eye follows its own camera. A picture in which no eye was found holds for a second what was shown, a
camera that delivers nothing for 200 ms; then the eye follows the other one, and when both are lost
a walk of the gaze graph. Every change of source is a short fade from what was shown last. The
features of borrowed and of synthesised eyes come from the encoder's own map from gaze and lid to
features, so one checkpoint of the denoiser knows all of them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from encoder.eyes.calibration import EyeCalibration
from encoder.eyes.conjugate import joined
from encoder.eyes.encoder import (
    MIRROR,
    NO_GAZE,
    EncoderState,
    EyeEncoder,
    EyeReading,
    new_encoder_state,
)
from encoder.eyes.fading import (
    FADE_FRAMES,
    Array,
    ShownEyes,
    bounded,
    calmed,
    limited,
    mixed,
    put,
    turned,
)
from encoder.eyes.format import within
from encoder.eyes.gaze_walk import GazeWalk, WalkState
from encoder.eyes.session import SessionState, learned, new_session
from sensors.types import FPS

OWN, OTHER, WALK = 0, 1, 2  # source of an eye
SOURCES = ("camera", "other eye", "synthesised")
HOLD_FRAMES = FPS // 5  # 200 ms without a picture
NO_EYE_FRAMES = FPS  # 1 s of pictures without an eye
# Smoothed probability of an eye: it is found above FOUND and lost below GONE. A picture
# below BLIND shows none, whatever the previous ones showed.
FOUND, GONE, BLIND, SCORE_SHARE = 0.6, 0.3, 0.1, 0.15
SHUT, OPEN = 0.12, 0.35  # lid openings: below the first gaze is invisible, above the second visible


@dataclass(frozen=True, eq=False)
class EyeState:
    """A value."""

    walk: WalkState
    shown: ShownEyes | None  # of the last frame; None before the first
    faded: ShownEyes | None  # where the running fades began
    session: SessionState
    encoder: EncoderState
    calibration: EyeCalibration | None = None  # of the person, or as recentred
    knows_lids: bool = False  # the calibration was made by the person
    own: Array | None = None  # [2, 3] gaze that the cameras told, calmed; None: nothing lately
    source: tuple[int, int] = (WALK, WALK)
    lost: tuple[int, int] = (NO_EYE_FRAMES, NO_EYE_FRAMES)  # frames since the own eye was seen
    fade: tuple[int, int] = (FADE_FRAMES, FADE_FRAMES)  # frames since the source changed
    score: tuple[float, float] = (0.0, 0.0)  # smoothed probability of an eye
    there: tuple[bool, bool] = (False, False)  # an eye is in front of the camera
    walking: bool = False


class EyeTracker:
    """step(reading, fresh, state) -> ShownEyes; holds weights only."""

    def __init__(self, encoder: EyeEncoder, walk: GazeWalk) -> None:
        self.encoder, self.walk = encoder, walk

    def init_state(self, calibration: EyeCalibration | None = None) -> EyeState:
        walk = self.walk.init_state()
        known = calibration is not None
        encoder = new_encoder_state()
        return EyeState(walk, None, None, new_session(), encoder, calibration, known)

    def recentred(self, state: EyeState) -> EyeState:
        """What a camera shows now is straight ahead; unchanged while no camera sees an eye."""
        if state.shown is None or 0 not in state.lost:
            return state
        calibration = _calibration(state).recentred(state.shown.gaze)
        return replace(state, calibration=calibration)

    def step(
        self,
        reading: EyeReading | None,  # None: no camera has delivered anything
        fresh: NDArray[np.bool_],  # [2] the picture is new enough
        state: EyeState,
    ) -> tuple[ShownEyes, EyeState]:
        good, state = _noticed(reading, fresh, state)
        own, lids, told = None, np.zeros(2, np.float32), NO_GAZE
        if reading is not None and good.any():
            lids, told = reading.lids, reading.told(good)
            own = self._own(reading, told, good, state)
        session = learned(lids, told, good, state.session)
        lost = tuple(0 if good[e] else min(state.lost[e] + 1, NO_EYE_FRAMES + 1) for e in (0, 1))
        first = state.shown is None
        holds = [lost[eye] <= (NO_EYE_FRAMES if fresh[eye] else HOLD_FRAMES) for eye in (0, 1)]
        source = tuple(_source(e, good, holds, state.source, first) for e in (0, 1))
        walked, state = self._walked(WALK in source, bool(fresh.any()), state)
        parts: list[ShownEyes] = []
        fade, faded = list(state.fade), state.faded
        for eye in (0, 1):
            changed = source[eye] != state.source[eye]
            # an eye that comes back from a hold has not changed its source, but has to fade, too
            back = source[eye] == OWN and good[eye] and state.lost[eye] > 0
            # this eye's gaze is of both while both are seen
            other = good[eye] and good[1 - eye] != (state.lost[1 - eye] == 0)
            if (changed or back or other) and not first:
                fade[eye], faded = 0, put(faded, state.shown, eye)
            parts.append(self._target(eye, source[eye], bool(good[eye]), own, walked, state))
        seen = ShownEyes(*(np.stack(rows) for rows in zip(*parts, strict=True)))
        if faded is not None and min(fade) < FADE_FRAMES:
            seen = mixed(faded, seen, fade)
        if state.shown is not None:
            seen = seen._replace(gaze=limited(state.shown.gaze, seen.gaze))
        fade = [min(f + 1, FADE_FRAMES) for f in fade]
        after = replace(
            state, shown=seen, faded=faded, source=source, lost=lost, fade=(fade[0], fade[1]),
            session=session, own=own.gaze if own else state.own,
        )  # fmt: skip
        return seen, after

    def _own(
        self, reading: EyeReading, told: Array, good: NDArray[np.bool_], state: EyeState
    ) -> ShownEyes:
        """The person's own gaze and lids, of the eyes that are seen; the features move along."""
        gaze, lids = _calibration(state).apply(told, reading.relative, reading.lids)
        read = self.encoder.synthesise(reading.as_features(told), reading.told_lids)
        change = self.encoder.synthesise(gaze, lids) - read
        features = bounded(reading.features + change.astype(np.float32))
        gaze = joined(gaze, reading.lids, reading.score * good)
        # calmed where both are seen as in the frame before; else the fade leads to what is read now
        steady = (good == (np.array(state.lost) == 0)).all()
        before = state.own if steady else None
        if before is not None:
            gaze = np.stack([calmed(before[e], gaze[e], float(reading.doubt[e])) for e in (0, 1)])
        elif state.shown is not None:
            before = state.shown.gaze
        if before is not None:  # a shut eye goes on looking where it looked
            sight = within((lids - SHUT) / (OPEN - SHUT), 0, 1).astype(np.float32)[:, None]
            gaze = np.where(sight < 1, turned(before, gaze, sight), gaze)
        return ShownEyes(features, gaze, lids)

    def _walked(
        self, needed: bool, delivers: bool, state: EyeState
    ) -> tuple[ShownEyes | None, EyeState]:
        """The next frame of synthesised eyes, begun where the eyes look now. While a camera
        delivers they do not blink: a blink of the head's is one that a camera saw."""
        if not needed:
            return None, replace(state, walking=False) if state.walking else state
        walk = state.walk
        if not state.walking and state.shown is not None:
            walk = self.walk.near(state.shown.gaze, walk)
        gaze, lid, walk = self.walk.step(walk)
        lids = np.full(2, 1.0 if delivers else lid, np.float32)
        walked = ShownEyes(self.encoder.synthesise(gaze, lids), gaze, lids)
        return walked, replace(state, walk=walk, walking=True)

    def _target(
        self, eye: int, source: int, good: bool, own: ShownEyes | None, walked: ShownEyes | None,
        state: EyeState,
    ) -> ShownEyes:  # fmt: skip
        """One eye's features, gaze and lid from its source."""
        shown = state.shown
        if source == WALK and walked is not None:
            return ShownEyes(walked.features[eye], walked.gaze[eye], walked.lids[eye])
        if source == OTHER and own is not None:
            there = ShownEyes(own.features[1 - eye], own.gaze[1 - eye], own.lids[1 - eye])
            gaze = np.stack([there.gaze, there.gaze])
            average = self.encoder.synthesise(gaze, np.stack([there.lids, there.lids]))
            # features are of left-like eyes: what looks out here looks in over there
            features = bounded(there.features + average[eye] - average[1 - eye])
            return ShownEyes(features, there.gaze, there.lids)
        if good and own is not None:
            return ShownEyes(own.features[eye], own.gaze[eye], own.lids[eye])
        assert shown is not None  # hold
        return ShownEyes(shown.features[eye], shown.gaze[eye], shown.lids[eye])


def eyes_in(state: EyeState) -> Array:
    """Where the eyes are looked for, in the cameras' own pictures: DrivenFrame.eye_frames."""
    x, y, log_size, turn = state.encoder.framing.frames.T
    side = MIRROR[:, 0]  # right eyes are looked at in a mirror
    return np.stack(
        [side * x, y, np.exp(log_size), side * turn, np.array(state.score, np.float32)], 1
    )


def _calibration(state: EyeState) -> EyeCalibration:
    """The person's; or what the session has learned, of which a recentred gaze leaves the lids."""
    learned = state.session.calibration()
    if state.calibration is None:
        return learned
    if state.knows_lids:
        return state.calibration
    return replace(state.calibration, shut=learned.shut, open=learned.open)


def _noticed(
    reading: EyeReading | None, fresh: NDArray[np.bool_], state: EyeState
) -> tuple[NDArray[np.bool_], EyeState]:
    """Which eyes are seen [2]."""
    good, score, there = np.zeros(2, np.bool_), list(state.score), list(state.there)
    for eye in (0, 1):
        if reading is None or not fresh[eye]:
            continue
        now = float(reading.score[eye])
        share = SCORE_SHARE if there[eye] or now < FOUND else 1.0
        score[eye] += share * (now - score[eye])
        there[eye] = score[eye] > (GONE if there[eye] else FOUND)
        good[eye] = there[eye] and now > BLIND
    return good, replace(state, score=(score[0], score[1]), there=(there[0], there[1]))


def _source(
    eye: int, good: NDArray[np.bool_], holds: list[bool], before: tuple[int, int], first: bool
) -> int:
    if good[eye]:
        return OWN
    if before[eye] == OWN and holds[eye] and not first:
        return OWN  # held
    if good[1 - eye]:
        return OTHER
    # the other eye may be held: then this one waits with it
    waits = before[eye] != WALK and before[1 - eye] == OWN and holds[1 - eye]
    return OWN if waits and not first else WALK
