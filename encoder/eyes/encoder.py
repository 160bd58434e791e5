"""The eye encoder at run time: a pair of near-eye pictures -> what they show (paper section 5.2).

Where: SensorFrame.eyes -> EyeFraming -> EyeEncoder -> EyeReading -> EyeTracker -> condition e and
gaze. ONNX Runtime on one thread; its only memory is where the eyes lie in the pictures, a value.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from encoder.eyes.conjugate import trust
from encoder.eyes.format import (
    GAZE_UNIT,
    MIN_SPREAD,
    RIG,
    SIDE,
    EyeNetConfig,
    doubt_of,
    length,
    unit,
    within,
)
from encoder.eyes.framing import EyeFraming, Framed, FramingState, new_framing
from encoder.nn.checkpoint import config_from, load
from sensors.types import InputError

Array = NDArray[np.float32]
MIRROR = np.array([[1.0], [-1.0]], np.float32)  # x of left, right: +x away from the nose
SIDES = np.array([[1.0, 1.0], [-1.0, 1.0]], np.float32)  # the same, of x and y
# Smoothed uncertainty in degrees: below the first, pictures resemble the training pictures of the
# features, which give gaze and lids; above the second the meter gives both.
USUAL_DOUBT, STRANGE_DOUBT = 2.5, 3.2
DOUBT_SHARE, AWAKE = 1 / 60, 0.5  # weight of a tick; least lid opening that counts
SLACK = 0.25  # degrees by which the doubt wanders with the gaze: no reason to trust others
PAIR_REACH = 0.1  # largest correction from both pictures together; twice that is ignored


SURE, OPEN_LIDS = np.zeros(2, np.float32), np.ones(2, np.float32)
NO_GAZE = np.zeros((2, 3), np.float32)
NO_PUPILS = np.full((2, 2), 0.5, np.float32)
NO_PICTURE = np.zeros((2, SIDE, SIDE), np.uint8)


class EyeReading(NamedTuple):
    """Left eye first. Everything is finite, whatever the pictures show."""

    features: Array  # [2, 80] in -1..1, of left-like eyes
    gaze: Array  # [2, 3] unit vectors, head frame, as each picture alone shows it
    lids: Array  # [2] opening: 0 shut .. 1 open
    score: Array  # [2] 0..1 probability of an eye; 0: a flat picture
    relative: Array  # [2, 3] gaze up to a constant of the wearer: the input of calibration
    together: Array  # [2, 3] gaze as both pictures show it: right while both eyes are seen
    # What the features themselves tell; all 0: just that.
    told_gaze: Array = NO_GAZE  # [2, 3]
    told_lids: Array = OPEN_LIDS  # [2]
    doubt: Array = SURE  # [2] estimated error of the gaze, degrees
    side: Array = SURE  # [2] 0..1: is this eye the one that its camera is to show, upright?
    pupils: Array = NO_PUPILS  # [2, 2] places in the framed picture, 0..1 from its upper left
    framed: NDArray[np.uint8] = NO_PICTURE  # [2, 100, 100] what the network saw: left-like eyes

    def told(self, good: NDArray[np.bool_] | None = None) -> Array:  # [2] -> [2, 3]
        """Gaze of each eye, from both pictures where both show an eye: see `joined`."""
        score = self.score if good is None else self.score * good
        away = self.together[:, :2] - self.gaze[:, :2]
        believed = within(2 - length(away).max() / PAIR_REACH, 0, 1)
        share = np.float32(trust(self.lids, score).min() * believed)
        return unit(self.gaze[:, :2] + share * away)

    def as_features(self, told: Array) -> Array:  # [2, 3] -> [2, 3]
        """The gaze that matches the features when `told` is displayed."""
        if not self.told_gaze.any():
            return told
        return unit(told[:, :2] + self.told_gaze[:, :2] - self.gaze[:, :2])


class Told(NamedTuple):
    """What the encoder's network says of a pair of pictures (encoder/eyes/graph.py)."""

    features: Array  # [2, 80]
    heads: Array  # [2, 11] gaze, lid, valid, rig
    relative: Array  # [2, 2]
    together: Array  # [2, 2]


class Measured(NamedTuple):
    """What the meter says of a pair of pictures, in the units that are used."""

    score: Array  # [2] 0..1
    lids: Array  # [2] opening, as measured
    gaze: Array  # [2, 2] of left-like eyes
    doubt: Array  # [2] degrees
    pupils: Array  # [2, 2] 0..1


@dataclass(frozen=True, eq=False)
class EncoderState:
    """State between ticks, a value: what is known about the cameras' pictures."""

    framing: FramingState
    doubt: Array  # [2] of the gaze in degrees, over the last seconds; 0: none was seen yet
    usual: Array  # [2] the same of this wearer and camera: follows where it goes beyond SLACK
    # Latest outputs of both networks.
    told: Told | None = None
    measured: Measured | None = None

    @property
    def strange(self) -> Array:  # [2] 0..1
        """How far pictures are from those that the features were trained on."""
        away = (self.usual - USUAL_DOUBT) / (STRANGE_DOUBT - USUAL_DOUBT)
        return within(away, 0, 1)


def new_encoder_state() -> EncoderState:
    """Before the first picture."""
    return EncoderState(new_framing(), np.zeros(2, np.float32), np.zeros(2, np.float32))


class EyeEncoder:
    """Holds weights only."""

    def __init__(self, config: EyeNetConfig, weights: dict[str, Any]) -> None:
        from encoder.eyes.graph import eye_model, meter_model
        from encoder.nn.onnx_session import session

        weights = {name: np.asarray(array, np.float32) for name, array in weights.items()}
        self.config, self.framing = config, EyeFraming(weights)
        self._session = session(eye_model(config, weights))
        self._meter = session(meter_model(config, weights))
        self._synthesis = [
            (weights[f"synthesis.{i}.weight"].T.copy(), weights[f"synthesis.{i}.bias"])
            for i in (0, 2)
        ]

    def __call__(self, eyes: NDArray[np.uint8]) -> EyeReading:  # [2, 400, 400] left, right
        """Reading without history: the eyes are searched for in these pictures alone."""
        return self.step(eyes, new_encoder_state())[0]

    def step(
        self,
        eyes: NDArray[np.uint8],  # [2, 400, 400] left, right
        state: EncoderState,
    ) -> tuple[EyeReading, EncoderState]:
        return self.read(self.framing.framed(eyes, state.framing), state)

    def read(self, framed: Framed, state: EncoderState) -> tuple[EyeReading, EncoderState]:
        """What pictures show that `EyeFraming.framed` has made ready."""
        pictures, small, spreads, framing = framed
        (features, heads, relative, together), measured, state = self._asked(
            small, replace(state, framing=framing)
        )
        # an eye counts only if both the framed and the whole picture show it
        score = np.minimum(measured.score, framing.chance)
        seen = spreads >= MIN_SPREAD
        state = _with_doubt(state, measured.doubt, measured.lids)
        told_lids, told_gaze = within(heads[:, 2], 0, 1), heads[:, :2]
        lids, alone, both = told_lids, told_gaze, together
        strange = state.strange
        if strange.any():
            lids = (lids + strange * (within(measured.lids, 0, 1) - lids)).astype(np.float32)
            alone, both = (xy + strange[:, None] * (measured.gaze - xy) for xy in (alone, both))
        gazes = unit(np.stack([alone, relative, both, told_gaze]) * SIDES)
        reading = EyeReading(
            features=features,
            gaze=gazes[0],
            lids=lids,
            score=score * seen,
            relative=gazes[1],
            together=gazes[2],
            told_gaze=gazes[3],
            told_lids=told_lids,
            doubt=measured.doubt,
            side=_chance(heads[:, 3]) * seen,
            pupils=measured.pupils,
            framed=pictures,
        )
        return reading, state

    def _asked(self, small: Array, state: EncoderState) -> tuple[Told, Measured, EncoderState]:
        """What is told, and measures; not every tick asks both networks, which would cost twice.

        Usual pictures are the encoder's: the meter is asked at every fourth tick. Strange ones are
        the meter's: features are asked for at every second, and moved along by what it measures.
        """
        told, measured, tick, strange = (
            state.told,
            state.measured,
            state.framing.tick,
            state.strange,
        )
        if told is None or strange.min() < 1 or tick % 2 == 0:
            told = Told(*self._session.run(None, {"pixels": small}))
        if measured is None or strange.max() > 0 or tick % 4 == 0:
            measured = _measured(self._meter.run(None, {"pixels": small})[0])
        return told, measured, replace(state, told=told, measured=measured)

    def synthesise(
        self,
        gaze: Array,  # [2, 3] unit vectors, head frame
        lids: Array,  # [2] opening
    ) -> Array:  # [2, 80]
        """The features that such eyes would give on average."""
        face = np.zeros((2, 2 + len(RIG)), np.float32)
        face[:, :1] = gaze[:, :1] * MIRROR / GAZE_UNIT
        face[:, 1] = gaze[:, 1] / GAZE_UNIT
        face[:, 2] = 1 - lids  # eyeBlink
        (first, first_bias), (second, second_bias) = self._synthesis
        return np.tanh(np.tanh(face @ first + first_bias) @ second + second_bias)


def _with_doubt(state: EncoderState, doubt: Array, lids: Array) -> EncoderState:
    """The doubts [2] of one more pair of pictures, where the eyes are open."""
    first = state.doubt == 0
    share = np.where(first, 1.0, DOUBT_SHARE) * (lids > AWAKE)
    doubt = (state.doubt + share * (doubt - state.doubt)).astype(np.float32)
    slack = np.where(first, np.float32(0), np.float32(SLACK))
    usual = np.minimum(np.maximum(state.usual, doubt - slack), doubt + slack)
    return replace(state, doubt=doubt, usual=usual)


def _measured(raw: Array) -> Measured:  # [2, 8] MEASURES
    doubt = np.degrees(GAZE_UNIT * doubt_of(raw[:, 4])).astype(np.float32)
    gaze, pupils = np.float32(GAZE_UNIT) * raw[:, 2:4], within(0.5 + 0.5 * raw[:, 5:7], 0, 1)
    return Measured(_chance(raw[:, 0]), raw[:, 1], gaze, doubt, pupils)


def _chance(logits: Array) -> Array:
    return (1 / (1 + np.exp(-within(logits, -30, 30)))).astype(np.float32)


def load_eye_encoder(folder: Path) -> EyeEncoder:
    """The trained eye encoder of a weights folder; InputError where it is missing or damaged."""
    weights, card = load(folder / "eyes", "eyes")
    try:
        return EyeEncoder(config_from(EyeNetConfig, card["config"]), weights)
    except KeyError as missing:
        raise InputError(
            f"checkpoint {folder / 'eyes'}: expected weights named {missing}, got none; "
            "it is of another version: run `livedrive train eyes` or restore the file"
        ) from None
