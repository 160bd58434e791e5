"""Emotions at run time: words -> intensities, cross-faded -> shifts and scales in the denoiser.

Words come from the command line, the network or a session's timeline: `happy`, `happy:0.7`,
`happy:0.5+surprised:0.3`, `neutral`. In the flow this lies between SensorFrame and Backend.denoise
(paper section 5.1); it depends on the frames so far and on nothing else.
"""

from __future__ import annotations

from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path

import numpy as np

from encoder.denoiser.config import ZeroConvConfig, zero_conv_shapes
from encoder.denoiser.live import emotion_table
from encoder.nn.checkpoint import check_shapes, config_from, load
from encoder.types import Floats, Mood
from sensors.types import FPS, InputError

NEUTRAL = "neutral"
FADE_FRAMES = round(0.3 * FPS)  # from one emotion to the next
MAX_PARTS = 2


@dataclass(frozen=True, eq=False)
class Emotions:
    """Shifts and scales of each label at full intensity, and how words become a mixture of them."""

    labels: tuple[str, ...]
    table: Floats  # [labels, width], see zero_conv.py

    def mixture(self, words: str) -> Floats:
        """Intensities [labels] float32, 0..1, of `words`.

        Raises InputError at unknown words, intensities out of range, or too many parts.
        """
        result = np.zeros(len(self.labels), np.float32)
        parts = [part.strip() for part in words.split("+")] if words.strip() else []
        if len(parts) > MAX_PARTS:
            raise InputError(
                f"emotion: expected at most {MAX_PARTS} emotions, got {words!r}; "
                "try happy:0.5+surprised:0.5"
            )
        for part in parts:
            name, colon, number = part.partition(":")
            intensity = _intensity(number, part) if colon else 1.0 / len(parts)
            if name.strip() != NEUTRAL:
                result[self._index(name.strip())] += intensity
        if result.sum() > 1 + 1e-6:
            raise InputError(
                f"emotion: expected intensities that add up to at most 1, got {words!r}; "
                "try happy:0.5+surprised:0.5"
            )
        return result

    def check(self, words: str) -> None:
        """Raise InputError at words of a user that are no mixture, or name an emotion twice; a
        session may hold such, from before they were refused."""
        self.mixture(words)
        names = [part.partition(":")[0].strip() for part in words.split("+")]
        if len(set(names)) < len(names):
            raise InputError(
                f"emotion: expected each emotion once, got {words!r}; try {names[0] or NEUTRAL}"
            )

    def _index(self, name: str) -> int:
        if name not in self.labels:
            near = get_close_matches(name, self.labels, 1)
            hint = f"did you mean {near[0]}?" if near else "--clip FOLDER understands other words"
            raise InputError(
                f"emotion: expected {NEUTRAL}, {', '.join(self.labels)}, got {name!r}; {hint}"
            )
        return self.labels.index(name)

    def step(self, words: str, mood: Mood) -> tuple[Floats | None, Mood]:
        """One frame -> [width] float32 for the denoiser (None: neutral), and the next state.

        New words start a fade from wherever the last one has got to.
        """
        if words != mood.words:
            mood = Mood(words, self._now(mood), self.mixture(words), FADE_FRAMES)
        mood = Mood(mood.words, mood.start, mood.end, max(mood.left - 1, 0))
        now = self._now(mood)
        return (now @ self.table if now.any() else None), mood

    def _now(self, mood: Mood) -> Floats:
        if mood.start is None or mood.end is None:
            return np.zeros(len(self.labels), np.float32)
        if mood.left == 0:
            return mood.end
        share = 1 - mood.left / FADE_FRAMES
        return ((1 - share) * mood.start + share * mood.end).astype(np.float32)


def _intensity(number: str, part: str) -> float:
    try:
        value = float(number)
    except ValueError:
        value = float("nan")
    if not 0 <= value <= 1:
        raise InputError(f"emotion: expected an intensity in 0..1, got {part!r}; try happy:0.7")
    return value


def load_emotions(folder: Path, student_sha256: str) -> Emotions | None:
    """The emotions trained for this student; None where there are none, or for another student."""
    path = folder / "emotion"
    if not path.with_suffix(".json").is_file():
        return None
    weights, card = load(path, "emotion")
    if card["student_sha256"] != student_sha256:
        return None
    config = config_from(ZeroConvConfig, card["config"])
    check_shapes(weights, zero_conv_shapes(config), path, "emotion")
    return Emotions(config.labels, emotion_table(config, weights))
