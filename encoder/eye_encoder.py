"""The eye encoder at run time: a pair of near-eye pictures -> what they show (paper section 5.2).

Where: SensorFrame.eyes -> EyeEncoder -> EyeReading -> EyeTracker -> condition e and gaze. ONNX
Runtime on one thread; frame by frame, so streaming and offline are the same thing.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from encoder.checkpoint import config_from, load
from encoder.eye_format import GAZE_UNIT, MIN_SPREAD, RIG, EyeNetConfig, normalised, pixels, unit
from sensors.types import InputError

Array = NDArray[np.float32]
MIRROR = np.array([[1.0], [-1.0]], np.float32)  # x of left, right: +x away from the nose
SIDES = np.array([[1.0, 1.0], [-1.0, 1.0]], np.float32)  # the same, of x and y
OPEN = 0.35  # lid opening from which on gaze is seen well
USUAL_VERGENCE, MAX_VERGENCE = 0.064, 0.16  # of x, right minus left: at 1 m, at 40 cm
VERGENCE_TRUST = 0.25  # each eye errs by more than vergence varies


def conjugate(
    xy: Array,  # [2, 2] of both eyes, head frame
    weight: Array,  # [2] 0..1 how well each eye is seen
) -> Array:  # [2, 2]
    """Eyes move together: one direction from both, as high as each other, converging a little."""
    share = (weight + 1e-3) / (weight + 1e-3).sum()
    vergence = np.clip(xy[1, 0] - xy[0, 0], 0, MAX_VERGENCE) - USUAL_VERGENCE
    vergence = USUAL_VERGENCE + VERGENCE_TRUST * weight.min() * vergence
    half = np.array([[-0.5 * vergence, 0], [0.5 * vergence, 0]], np.float32)
    middle = (share[:, None] * (xy - half)).sum(0)
    return (middle + half).astype(np.float32)


def trust(lids: Array, score: Array) -> Array:  # [2] each -> [2]
    """How well each eye is seen, 0..1: one that is shut or doubtful says little."""
    return (score * np.clip(lids / OPEN, 0, 1)).astype(np.float32)


def joined(
    gaze: Array,  # [2, 3] unit vectors
    lids: Array,  # [2] opening
    score: Array,  # [2]
) -> Array:  # [2, 3]
    """Where both eyes look. After calibration: what is personal differs from eye to eye, and a mean
    of both with changing weights would mix it.
    """
    return unit(conjugate(gaze[:, :2], trust(lids, score)))


class EyeReading(NamedTuple):
    """Left eye first. Everything is finite, whatever the pictures show."""

    features: Array  # [2, 80] in -1..1, of left-like eyes
    gaze: Array  # [2, 3] unit vectors, head frame, as each picture alone shows it
    lids: Array  # [2] opening: 0 shut .. 1 open
    score: Array  # [2] 0..1: is this the right eye, seen by a working camera? 0: a flat picture
    relative: Array  # [2, 3] gaze but for a constant of the wearer: what calibration maps
    together: Array  # [2, 3] gaze as both pictures show it: right while both eyes are seen

    def told(self, good: NDArray[np.bool_] | None = None) -> Array:  # [2] -> [2, 3]
        """Gaze of each eye, told by both pictures as far as both show an eye: see `joined`."""
        score = self.score if good is None else self.score * good
        share = trust(self.lids, score).min()
        return unit(self.gaze[:, :2] + share * (self.together[:, :2] - self.gaze[:, :2]))


class EyeEncoder:
    """Holds weights only."""

    def __init__(self, config: EyeNetConfig, weights: dict[str, Any]) -> None:
        from encoder.backends import session
        from encoder.eye_graph import eye_model

        weights = {name: np.asarray(array, np.float32) for name, array in weights.items()}
        self.config = config
        self._session = session(eye_model(config, weights))
        self._relative = weights["relative"]
        self._synthesis, self._pair = (
            [(weights[f"{name}.{i}.weight"].T.copy(), weights[f"{name}.{i}.bias"]) for i in (0, 2)]
            for name in ("synthesis", "pair")
        )

    def __call__(
        self,
        eyes: NDArray[np.uint8],  # [2, 400, 400] left, right
    ) -> EyeReading:
        small, spreads = normalised(pixels(eyes))
        features, heads = self._session.run(None, {"pixels": small})
        lids = np.clip(heads[:, 2], 0, 1)
        score = 1 / (1 + np.exp(-np.clip(heads[:, 3], -30, 30)))
        score = np.where(spreads < MIN_SPREAD, np.float32(0), score)
        relative = features @ self._relative[:-1] + self._relative[-1]
        pair = np.concatenate([features, features[::-1]], 1)
        together = heads[:, :2] + np.float32(GAZE_UNIT) * _through(self._pair, pair)
        gazes = [unit(xy * SIDES) for xy in (heads[:, :2], relative, together)]
        return EyeReading(features, gazes[0], lids, score.astype(np.float32), *gazes[1:])

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
        return np.tanh(_through(self._synthesis, face))


def _through(layers: list[tuple[Array, Array]], x: Array) -> Array:
    (first, first_bias), (second, second_bias) = layers
    return np.tanh(x @ first + first_bias) @ second + second_bias


def load_eye_encoder(folder: Path) -> EyeEncoder:
    """The trained eye encoder of a weights folder; InputError where it is missing or damaged."""
    tensors, card = load(folder / "eyes", "eyes")
    weights = {name: tensor.float().numpy() for name, tensor in tensors.items()}
    try:
        return EyeEncoder(config_from(EyeNetConfig, card["config"]), weights)
    except KeyError as missing:
        raise InputError(
            f"checkpoint {folder / 'eyes'}: expected weights named {missing}, got none; "
            "it is of another version: run `livedrive train eyes` or restore the file"
        ) from None
