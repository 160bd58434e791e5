"""One rule-made subject: a voice, a style, freeform speech, read sentences, emotions and silence.

Between speech and motion on one side and the data set on the other: plan -> takes.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from encoder.capture.dataset import Clip, make_clip
from encoder.capture.motion.channels import RIG_NAMES
from encoder.capture.motion.contacts import LipGeometry
from encoder.capture.motion.rules import frame_times, speech_curves
from encoder.capture.motion.style import Style
from encoder.capture.motion.upper_face import upper_face
from encoder.capture.speech.corpus import freeform, sentences
from encoder.capture.speech.languages import TEXTS
from encoder.capture.speech.phones import PHONE_INDEX, Phone, Speech, pack_phones
from encoder.capture.speech.synthesis import Espeak
from encoder.capture.speech.training_texts import sentences_of
from encoder.capture.speech.voices import Voice, draw_voice, speak
from encoder.emotion.labels import LABELS
from sensors.types import FPS, SAMPLE_RATE, SAMPLES_PER_FRAME

# shares of a subject's time; the paper's capture is about 5 minutes freeform, 1.7 of sentences
SHARES = {"freeform": 0.55, "sentence": 0.25, "emotion": 0.12, "rest": 0.08}
VOICES = 5  # drawn for each sentence of a further language


@dataclass(frozen=True)
class Take:
    """A clip with its sound as the session keeps it."""

    audio: np.ndarray  # [1600 T] float32 -1..1, 48 kHz
    clip: Clip


def take(
    audio: np.ndarray, rig: np.ndarray, gaze: np.ndarray, phones: np.ndarray, **more: Any
) -> Take:
    """Cut sound and curves to whole frames."""
    clip = make_clip(audio, rig, gaze, phones, **more)
    return Take(audio[: clip.num_frames * SAMPLES_PER_FRAME].astype(np.float32), clip)


def phone_labels(phones: list[Phone], num_frames: int) -> np.ndarray:
    """[T] index of the phone that sounds 20 ms before the frame's time; 0 (silence) where none."""
    times = frame_times(num_frames) - 0.02
    labels = np.zeros(num_frames, np.int64)
    for phone in phones:
        labels[(times >= phone.start) & (times < phone.end)] = PHONE_INDEX[phone.name]
    return labels


def join(parts: list[Speech], pauses_s: tuple[float, float], rng: np.random.Generator) -> Speech:
    """Runs of speech with pauses before, between and after them."""
    audio, phones, start = [], [], 0.0
    for part in [*parts, None]:
        pause = np.zeros(int(rng.uniform(*pauses_s) * SAMPLE_RATE), np.float32)
        audio.append(pause)
        phones.append(Phone("pau", start, start + len(pause) / SAMPLE_RATE))
        start += len(pause) / SAMPLE_RATE
        if part is not None:
            audio.append(part.audio)
            phones += [Phone(p.name, p.start + start, p.end + start) for p in part.phones]
            start += len(part.audio) / SAMPLE_RATE
    return Speech(np.concatenate(audio), phones)


@dataclass(frozen=True)
class Talker:
    """A subject: everything that is the same in all of its takes."""

    voice: Voice
    style: Style
    lips: LipGeometry | None
    split: str


def spoken_take(
    speech: Speech,
    who: Talker,
    rng: np.random.Generator,
    *,
    truth: str = "rules",
    kind: str = "freeform",
    text: str = "",
    emotion: str = "neutral",
    voice: str = "",
) -> Take:
    """Motion for speech, at a level somewhere between -14 and -1 dBFS."""
    peak = max(float(np.abs(speech.audio).max()), 1e-3)
    audio = speech.audio * np.float32(10 ** (rng.uniform(-14, -1) / 20) / peak)
    strength = float(rng.uniform(0.7, 1.1)) if emotion != "neutral" else 0.0
    motion = speech_curves(
        speech.phones, audio, who.style, rng,
        lips=who.lips, reading=kind in ("sentence", "language"), emotion=emotion, strength=strength,
    )  # fmt: skip
    labels = phone_labels(speech.phones, len(motion.rig))
    return take(
        audio, motion.rig, motion.gaze, labels,
        tongue=motion.tongue, spans=pack_phones(speech.phones),
        truth=truth, voice=voice or who.voice.name, split=who.split,
        kind=kind, text=text, emotion=emotion,
    )  # fmt: skip


def subject_takes(
    seconds: float, split: str, lips: LipGeometry | None, seed: tuple[int, ...]
) -> Iterator[Take]:
    """A subject's takes: freeform, sentences, emotions in turn and rest, `seconds` in all."""
    rng = np.random.default_rng(seed)
    who = Talker(draw_voice(split, rng), Style.draw(rng), lips, split)
    espeak, mood = Espeak(), int(rng.integers(len(LABELS)))
    for kind, share in SHARES.items():
        left = share * seconds
        while left > 0:
            if kind == "rest":
                made = rest_take(float(rng.uniform(4, 9)), split, rng)
            else:
                label = LABELS[mood % len(LABELS)] if kind == "emotion" else ""
                mood += kind == "emotion"
                made = _speech_take(kind, label or "neutral", who, espeak, rng)
            left -= made.clip.num_frames / FPS
            yield made


def _speech_take(
    kind: str, emotion: str, who: Talker, espeak: Espeak, rng: np.random.Generator
) -> Take:
    number = int(rng.integers(1 << 31))
    if kind == "sentence":
        texts, pauses = sentences(1, number, who.split), (0.25, 0.7)
    elif kind == "freeform":
        texts, pauses = freeform(int(rng.integers(1, 4)), number, who.split), (0.2, 1.6)
    else:
        texts, pauses = sentences(2, number, who.split), (0.2, 0.9)
    speech = join(speak(who.voice, texts, emotion, espeak, rng), pauses, rng)
    return spoken_take(
        speech, who, rng, kind=kind, text=" ".join(texts), emotion=emotion,
        truth="emotional" if kind == "emotion" else "rules",
    )  # fmt: skip


def language_takes(
    language: str, split: str, lips: LipGeometry | None, seed: tuple[int, ...]
) -> Iterator[Take]:
    """The sentences of a further language, VOICES times, each in a voice drawn anew."""
    rng, espeak = np.random.default_rng(seed), Espeak()
    texts = list(TEXTS[language]) if split == "test" else sentences_of(language)
    for text in VOICES * texts:
        who = Talker(draw_voice(split, rng, language), Style.draw(rng), lips, split)
        speech = join(speak(who.voice, [text], "neutral", espeak, rng), (0.25, 0.7), rng)
        yield spoken_take(speech, who, rng, kind="language", text=text)


def rest_take(seconds: float, split: str, rng: np.random.Generator) -> Take:
    """Silence, noise, breath, hum or clicks: the lips rest, eyes and lids go on."""
    kind = str(rng.choice(["zero", "noise", "noise", "breath", "hum", "clicks"]))
    audio = np.clip(_not_speech(kind, seconds, rng), -1, 1)
    num_frames = len(audio) // SAMPLES_PER_FRAME
    upper, gaze = upper_face(np.zeros(num_frames), rng)
    return take(
        audio, upper.reshape(-1, len(RIG_NAMES)), gaze, np.zeros(num_frames),
        truth="rest", voice=f"rest-{kind}", split=split, kind="rest",
    )  # fmt: skip


def _coloured(count: int, slope: float, rng: np.random.Generator) -> np.ndarray:
    """Noise of power ~ f^-slope, unit RMS."""
    spectrum = np.fft.rfft(rng.standard_normal(count))
    spectrum *= np.maximum(np.arange(len(spectrum)) / len(spectrum), 1e-3) ** (-slope / 2)
    noise = np.fft.irfft(spectrum, count)
    return noise / noise.std()


def _not_speech(kind: str, seconds: float, rng: np.random.Generator) -> np.ndarray:
    """[n] at 48 kHz: what a microphone hears when nobody speaks."""
    count = int(seconds * FPS) * SAMPLES_PER_FRAME
    time = np.arange(count) / SAMPLE_RATE
    level = 10 ** (rng.uniform(-75, -24) / 20)
    if kind == "zero":
        return np.zeros(count)
    if kind == "noise":
        return level * _coloured(count, rng.uniform(0, 2), rng)
    if kind == "breath":  # slow swells of soft high noise
        swell = np.clip(np.sin(2 * np.pi * time / rng.uniform(2.5, 5) + rng.uniform(0, 6)), 0, 1)
        return 0.3 * level * (_coloured(count, 0.5, rng) * swell**2 + 0.05)
    if kind == "hum":
        base = rng.choice([50, 60, 100, 120]) * rng.uniform(0.98, 1.02)
        tones = [np.sin(2 * np.pi * base * k * time) / k for k in range(1, 6)]
        return level * (np.sum(tones, 0) + 0.1 * _coloured(count, 1, rng))
    audio = 0.02 * level * _coloured(count, 1, rng)  # clicks: keys, mouse, knocks
    for start in rng.integers(0, count - 4000, int(seconds * rng.uniform(0.5, 6))):
        decay = np.exp(-np.arange(4000) / rng.uniform(60, 900))
        audio[start : start + 4000] += 3 * level * decay * rng.standard_normal(4000)
    return audio
