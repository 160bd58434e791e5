"""Rule-made takes told again: the same words and eyes with each emotion.

For judging only. The rules are run again on the take's sound and phones with one random source, so
that the versions differ in nothing but the emotion's layer and the size of the mouth's motion.
"""

import numpy as np

from encoder.capture.dataset import Clip
from encoder.capture.motion.contacts import LipGeometry
from encoder.capture.motion.rules import Motion, speech_curves
from encoder.capture.motion.style import Style
from encoder.capture.speech.phones import unpack_phones
from encoder.capture.speech.voices import draw_voice
from encoder.emotion.labels import LABELS


def style_of(seed: list[int], split: str) -> Style:
    """How the rule-made subject of this seed moves, as `made.subject_takes` drew it."""
    rng = np.random.default_rng(seed)
    draw_voice(split, rng)
    return Style.draw(rng)


def with_each_emotion(
    clip: Clip, style: Style, lips: LipGeometry | None, strength: float, seed: int
) -> list[Motion]:
    """The clip's motion without emotion, then with each of LABELS at this strength."""
    sound = np.repeat(np.asarray(clip.audio, np.float32) / 32768, 2)  # 48 kHz: only loudness counts
    phones = unpack_phones(clip.spans)
    versions = [(LABELS[0], 0.0), *((label, strength) for label in LABELS)]
    return [
        speech_curves(
            phones, sound, style, np.random.default_rng(seed), lips=lips,
            reading=clip.kind == "sentence", emotion=label, strength=amount,
        )
        for label, amount in versions
    ]  # fmt: skip
