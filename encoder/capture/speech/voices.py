"""The voices of the capture: engines x speakers x formant shifts, each in one split for ever.

A base voice (one recorded speaker or one parameter set) is in the training or in the test split
with all its shifts: no test voice was ever heard in training.
"""

import shutil
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from encoder.capture.speech.phones import Speech
from encoder.capture.speech.synthesis import Espeak, speak_festival, speak_flite
from encoder.emotion.labels import EMOTIONS

_ESPEAK = (
    "f1 f2 f3 f4 f5 m1 m2 m3 m4 m5 m6 m7 m8 adam Alex anika Alicia Andrea Andy Annie antonio "
    "aunty belinda benjamin boris caleb david Denis Diogo ed edward Gene gustave Henrique Hugo "
    "Jacky john kaukovalta Lee linda marcelo Marco Mario max Michael michel miguel norbert pablo "
    "paul pedro quincy rob robert sandro shelby steph travis victor zac klatt klatt3 iven iven3 "
    "grandma grandpa"
)
_ACCENTS = ("en-us", "en-us", "en-us", "en", "en-gb-scotland", "en-029", "en-gb-x-rp")
_SHIFTS = (0.88, 0.94, 1.0, 1.07, 1.14)
TEST_BASES = ("f4", "m5", "Andrea", "max", "klatt3", "pedro", "kal16", "kal")
LICENCES = {
    "espeak": "espeak-ng (GPL-3 program; its output is free of it)",
    "flite": "flite (BSD-like, CMU)",
    "festival": "festival (BSD-like, CMU and Edinburgh)",
}


@dataclass(frozen=True)
class Voice:
    """One voice; `pitch`, `tempo` and `tone` are its own factors."""

    engine: str  # espeak, flite or festival
    base: str  # variant or speaker
    language: str  # espeak's language; the others speak en-us
    shift: float  # formants
    pitch: float = 1.0
    tempo: float = 1.0
    tone: float = 1.0

    @property
    def name(self) -> str:
        return f"{self.engine}-{self.language}+{self.base}x{self.shift:.2f}"

    @property
    def split(self) -> str:
        return "test" if self.base in TEST_BASES else "train"


def all_bases() -> dict[str, tuple[str, ...]]:
    """Engine -> base voices that are installed here."""
    bases = {"espeak": tuple(_ESPEAK.split()), "flite": ("slt", "rms", "awb", "kal16")}
    if shutil.which("festival"):
        bases["festival"] = ("slt_hts", "kal")
    return bases


def draw_voice(split: str, rng: np.random.Generator, language: str | None = None) -> Voice:
    """A voice of one split; the recorded speakers of flite and festival come more often."""
    bases = all_bases()
    engines = [e for e in bases if any((b in TEST_BASES) == (split == "test") for b in bases[e])]
    share = np.array([{"espeak": 0.55, "flite": 0.35, "festival": 0.1}[e] for e in engines])
    engine = "espeak" if language else str(rng.choice(engines, p=share / share.sum()))
    fitting = [b for b in bases[engine] if (b in TEST_BASES) == (split == "test")]
    pitch, tempo, tone = rng.uniform((0.8, 0.85, 0.6), (1.25, 1.3, 1.3))
    return Voice(
        engine,
        str(rng.choice(fitting)),
        language or (str(rng.choice(_ACCENTS)) if engine == "espeak" else "en-us"),
        float(rng.choice(_SHIFTS)),
        float(pitch),
        float(tempo),
        float(tone),
    )


def speak(
    voice: Voice, texts: Sequence[str], emotion: str, espeak: Espeak, rng: np.random.Generator
) -> list[Speech]:
    """Speak texts; an emotion changes tempo, pitch, its range and the energy."""
    mood = EMOTIONS[emotion]
    tempo = voice.tempo * mood.tempo
    vary = rng.uniform(0.94, 1.06, (len(texts), 3))
    if voice.engine == "festival":
        spoken = speak_festival(texts, voice.base, 1 / tempo, voice.shift)
    elif voice.engine == "flite":
        spoken = [
            speak_flite(text, voice.base, voice.pitch * mood.pitch * a, b / tempo, voice.shift)
            for text, (a, b, _) in zip(texts, vary, strict=True)
        ]
    else:
        spoken = []
        for text, (a, b, c) in zip(texts, vary, strict=True):
            words = int(np.clip(165 * tempo * b, 90, 260))
            pitch = int(np.clip(50 + 90 * (voice.pitch * mood.pitch * a / voice.shift - 1), 0, 99))
            tone = int(np.clip(50 * voice.tone * mood.tone * c, 5, 99))
            name = f"{voice.language}+{voice.base}"
            spoken.append(espeak.speak(text, name, words, pitch, tone, voice.shift))
    return [Speech(s.audio * np.float32(mood.energy), s.phones) for s in spoken]
