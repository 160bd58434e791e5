"""Brows, lids, nostrils and a relaxed rest, on top of the denoiser's expression.

Flashes of the brows at the strongest accents, 10 to 20 a minute of speech (Graf et al. 2002; Cave
et al. 1996), half a second long. Brows dip and cheeks squint with a blink. Breath at 0.2 to 0.3 Hz,
12 to 18 a minute of an adult at rest, is seen in the nostrils here and in the shoulders by the
decoder. The rest has no frown.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import cos, pi

import numpy as np

from encoder.alive import noise
from encoder.alive.prosody import Prosody
from encoder.types import Floats
from sensors.types import FPS

FLASH_ACCENT = 0.55  # strength from which on an accent raises the brows
FLASH_PAUSE = int(2.2 * FPS)  # frames from one flash to the next
FLASH_RISE, FLASH_HOLD, FLASH_FALL = 4, 4, 9  # frames
BREATH_HZ, BREATH_SPREAD_HZ = 0.25, 0.04
BREATH_KNOT = 4 * FPS
INHALE = 0.4  # of a breath
KIND = 30  # of noise
RELAXED = {
    "browInnerUp_L": 0.06,
    "browInnerUp_R": 0.06,
    "mouthSmile_L": 0.07,
    "mouthSmile_R": 0.06,
    "cheekSquint_L": 0.03,
    "cheekSquint_R": 0.03,
}
FLASH = {
    "browInnerUp_L": 0.42,
    "browInnerUp_R": 0.42,
    "browOuterUp_L": 0.40,
    "browOuterUp_R": 0.36,
    "eyeWide_L": 0.08,
    "eyeWide_R": 0.08,
}
WITH_BLINK = {
    "browDown_L": 0.10,
    "browDown_R": 0.10,
    "cheekSquint_L": 0.14,
    "cheekSquint_R": 0.14,
}
WITH_BREATH = {"noseSneer_L": 0.05, "noseSneer_R": 0.05}
LID_DOWN = {"eyeLookDown_L": 1.0, "eyeLookDown_R": 1.0}
LID_UP = {"eyeLookUp_L": 1.0, "eyeLookUp_R": 1.0}
# What one eye does, the other does: pairs of channels (looks aside go crosswise). The denoiser
# opens both alike only on average, and less so in emotions; without cameras nothing tells more.
ALIKE = (
    *((f"{name}_L", f"{name}_R") for name in (
        "eyeBlink", "eyeWide", "eyeSquint", "eyeLookUp", "eyeLookDown", "cheekSquint", "noseSneer",
    )),
    ("eyeLookIn_L", "eyeLookOut_R"),
    ("eyeLookOut_L", "eyeLookIn_R"),
)  # fmt: skip
LID_RAD = 0.44  # of gaze, at which the lids have followed in full


@dataclass(frozen=True)
class Shapes:
    """How named changes of the face move the code; of the decoder that shows it."""

    relaxed: Floats  # [256]
    flash: Floats  # [256]
    blink: Floats  # [256] what goes with a blink
    breath: Floats  # [256]
    lids_down: Floats  # [256]
    lids_up: Floats  # [256]
    reads_blink: Floats  # [256] a code times this is how far the eyes are shut
    reads_uneven: Floats  # [256, E] a code times this is how far the eyes differ, and ...
    uneven: Floats  # [E, 256] ... the codes of half of these differences

    @classmethod
    def of(cls, names: list[str], to_code: Floats, to_rig: Floats) -> Shapes:
        """`names` [R] of the rig, to_code [R, 256], to_rig [256, R]."""

        def code(parts: Mapping[str, float]) -> Floats:
            rig = np.zeros(len(names), np.float32)
            for name, value in parts.items():
                rig[names.index(name)] = value
            return (rig @ to_code).astype(np.float32)

        left, right = ([names.index(pair[side]) for pair in ALIKE] for side in (0, 1))
        shut = [names.index(f"eyeBlink_{side}") for side in "LR"]
        return cls(
            *map(code, (RELAXED, FLASH, WITH_BLINK, WITH_BREATH, LID_DOWN, LID_UP)),
            reads_blink=to_rig[:, shut].mean(1).astype(np.float32),
            reads_uneven=(to_rig[:, left] - to_rig[:, right]).astype(np.float32),
            uneven=(0.5 * (to_code[left] - to_code[right])).astype(np.float32),
        )


@dataclass(frozen=True)
class FaceState:
    """State between frames, a value."""

    since_flash: int = 100 * FPS
    strength: float = 0.0
    phase: float = 0.0  # of the breath, 0..1


def step(
    frame: int, prosody: Prosody, seed: int, state: FaceState
) -> tuple[float, float, FaceState]:
    """How far the brows are up, how full the lungs are (both 0..1), and the state after it."""
    since, strength = state.since_flash + 1, state.strength
    if prosody.accent >= FLASH_ACCENT and since >= FLASH_PAUSE:
        since, strength = 0, min(0.55 + 0.5 * prosody.accent, 1.0)
    hz = BREATH_HZ + BREATH_SPREAD_HZ * noise.wander(seed, KIND, frame, BREATH_KNOT)
    phase = (state.phase + hz / FPS) % 1.0
    warped = 0.5 * phase / INHALE if phase < INHALE else 0.5 + 0.5 * (phase - INHALE) / (1 - INHALE)
    lungs = 0.5 - 0.5 * cos(2 * pi * warped)
    return strength * _flash(since), lungs, FaceState(since, strength, phase)


def changed(
    expression: Floats, shapes: Shapes, brows: float, lungs: float, gaze_up: float
) -> Floats:
    """An expression [256] with all that; `gaze_up`: rad that the eyes were turned up afterwards."""
    shut = min(max(float(expression @ shapes.reads_blink), 0.0), 1.0)
    lids = shapes.lids_up if gaze_up > 0 else shapes.lids_down
    out = (expression + shapes.relaxed + np.float32(brows) * shapes.flash).astype(np.float32)
    out += np.float32(shut) * shapes.blink + np.float32(lungs) * shapes.breath
    out += np.float32(abs(gaze_up) / LID_RAD) * lids
    return out


def evened(expression: Floats, shapes: Shapes) -> Floats:
    """An expression [256] whose eyes do the same."""
    return (expression - expression @ shapes.reads_uneven @ shapes.uneven).astype(np.float32)


def _flash(since: int) -> float:
    """0..1 so many frames after a flash began."""
    held, gone = FLASH_RISE + FLASH_HOLD, FLASH_RISE + FLASH_HOLD + FLASH_FALL
    if since >= gone:
        return 0.0
    share = (since + 1) / FLASH_RISE if since < FLASH_RISE else (gone - since) / (gone - held)
    share = min(max(share, 0.0), 1.0)
    return share * share * (3 - 2 * share)
