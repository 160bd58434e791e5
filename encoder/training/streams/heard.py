"""Training data of the audio encoder: crops of speech in noise, and what is said in them.

Each clip of the pack becomes a `Heard` once: sound, phones, the teacher's visemes and pitch at the
encoder's own rate. Crops are played a little faster or slower, louder or softer, with babble,
rubbing, wind and music; some hold only distant voices.
"""

from dataclasses import dataclass, replace

import numpy as np
import soxr

from encoder.capture.dataset import PACK_RATE, Clip
from encoder.capture.speech.handling import HANDLING
from encoder.training.streams.augment import clicks, music, noise
from encoder.training.viseme_teacher import VISEME_OF_PHONE, VISEMES, VisemeTeacher

HOP = 200  # samples a feature
LABEL_LATE_S = 0.015  # a feature tells the phone that sounded so long ago
AHEAD = 8  # features by which what comes next lies ahead of that
VOICELESS = 0.09  # share of crops
SURE = 0.97  # of a viseme whose phone is known
PITCH_HZ = 150.0  # from which pitch is told, in octaves
_NOISES = (noise, clicks, music, music, *HANDLING, *HANDLING)


@dataclass(frozen=True, eq=False)
class Heard:
    audio: np.ndarray  # [200 N] int16
    phones: np.ndarray  # [N] int8, -1 unknown
    visemes: np.ndarray  # [N, 15] float16, 0..1
    pitch: np.ndarray  # [N, 2] float16: voiced 0..1, octaves
    kind: str  # truth of its clip


@dataclass(frozen=True)
class Lesson:
    """A crop: its sound, and the target of the encoder's output."""

    noisy: np.ndarray  # [200 N] float32
    clean: np.ndarray  # [200 N] float32
    phones: np.ndarray  # [N] int64
    visemes: np.ndarray  # [N, 15] float32
    ahead: np.ndarray  # [N, 15] float32, what comes next
    pitch: np.ndarray  # [N, 2] float32


def prepare(clip: Clip, teacher: VisemeTeacher | None) -> Heard:
    """Targets of a clip. Phones come from its spans, if any. Visemes follow from the phones; for
    real voices half comes from the teacher, for voices without text all."""
    count = len(clip.audio) // HOP
    audio = np.array(clip.audio[: count * HOP])
    times = (np.arange(count) + 1) * HOP / PACK_RATE
    known = len(clip.spans) > 0 or clip.truth == "rest"
    phones = np.full(count, 0 if known else -1, np.int8)
    for phone, start, end in clip.spans:
        phones[(times - LABEL_LATE_S >= start) & (times - LABEL_LATE_S < end)] = int(phone)
    sound = audio.astype(np.float32) / 32768
    visemes = np.zeros((count, len(VISEMES)), np.float32)
    if known:
        visemes[np.arange(count), VISEME_OF_PHONE[phones]] = SURE
    if teacher is not None and (not known or clip.voice.startswith(("real-", "grid-"))):
        guess = teacher.probabilities(sound, PACK_RATE, times)
        visemes = 0.5 * visemes + 0.5 * guess if known else guess
    return Heard(audio, phones, visemes.astype(np.float16), pitch(sound)[:count], clip.truth)


def pitch(sound: np.ndarray) -> np.ndarray:
    """[200 N] -> [N, 2] voiced 0..1 and octaves above PITCH_HZ, by autocorrelation of 40 ms."""
    rate, size, hop, shortest, longest = 6000, 240, 50, 13, 100
    low = np.pad(soxr.resample(sound, PACK_RATE, rate), (size - hop, hop))
    window = np.hanning(size)
    waves = np.lib.stride_tricks.sliding_window_view(low, size)[::hop][: len(sound) // HOP]
    waves = waves * window - (waves * window).mean(1, keepdims=True)
    likeness = np.fft.irfft(np.abs(np.fft.rfft(waves, 512)) ** 2)[:, :longest]
    bias = np.fft.irfft(np.abs(np.fft.rfft(window, 512)) ** 2)[:longest]
    energy = likeness[:, :1] + 1e-7
    curve = (likeness / energy / np.maximum(bias / bias[0], 0.2))[:, shortest:]
    best = curve.max(1)
    peak = np.zeros(curve.shape, bool)
    peak[:, 1:-1] = (curve[:, 1:-1] >= curve[:, :-2]) & (curve[:, 1:-1] >= curve[:, 2:])
    peak &= curve >= 0.9 * best[:, None]
    lag = np.where(peak.any(1), peak.argmax(1), curve.argmax(1)) + shortest
    loud = 10 * np.log10(energy[:, 0] / energy.max()) > -45
    voiced = np.clip((best - 0.65) / 0.2, 0, 1) * loud
    return np.stack([voiced, np.log2(rate / lag / PITCH_HZ)], 1).astype(np.float16)


def cut(heard: Heard, count: int, rng: np.random.Generator) -> Lesson:
    """A crop of `count` features from anywhere in a clip, with silence beyond its ends."""
    speed = float(rng.uniform(0.88, 1.14)) if rng.random() < 0.5 else 1.0
    total, need = len(heard.phones), int(count * speed) + 1
    low, high = min(0, total - need), max(0, total - need)
    start = int(rng.integers(max(low, -60), high + 1))
    where = start * HOP + np.arange(count * HOP) * speed
    clean = np.interp(where, np.arange(len(heard.audio)), heard.audio, 0, 0) / 32768
    now = np.ceil(start + (np.arange(count) + 1) * speed - 1 - 1e-6).astype(int)
    inside = (now >= 0) & (now < total)
    place = np.clip(now, 0, total - 1)
    silence = 0 if (heard.phones >= 0).any() else -1
    phones = np.where(inside, heard.phones[place], silence).astype(np.int64)
    tone = heard.pitch[place].astype(np.float32) + np.array([0, np.log2(speed)], np.float32)
    tone[~inside] = 0
    clean = clean.astype(np.float32)
    visemes, ahead = (_visemes(heard, place) for place in (now, now + AHEAD))
    return Lesson(clean, clean, phones, visemes, ahead, tone)


def _visemes(heard: Heard, place: np.ndarray) -> np.ndarray:  # [N, 15]; silence beyond the ends
    inside = (place >= 0) & (place < len(heard.visemes))
    found = heard.visemes[np.clip(place, 0, len(heard.visemes) - 1)].astype(np.float32)
    found[~inside] = np.eye(len(VISEMES))[0]
    return found


def _level(sound: np.ndarray) -> float:
    return float(np.sqrt((sound**2).mean() + 1e-9))


def _babble(lessons: list[Lesson], rng: np.random.Generator, least: int = 1) -> np.ndarray:
    """At least so many and at most six other voices of the batch at once, at unit RMS."""
    others = [lessons[i].clean for i in rng.integers(len(lessons), size=rng.integers(least, 7))]
    sound = np.sum([x / max(_level(x), 1e-3) * rng.uniform(0.3, 1) for x in others], 0)
    return sound / _level(sound)


def amid_noise(lessons: list[Lesson], rng: np.random.Generator) -> list[Lesson]:
    """Set each lesson to its own level (-54 to -14 dBFS), most of them with noise."""
    return [
        _voiceless(lesson, lessons, rng)
        if rng.random() < VOICELESS
        else _noisy(lesson, lessons, rng)
        for lesson in lessons
    ]


def _noise(count: int, rng: np.random.Generator) -> np.ndarray:
    sound = _NOISES[rng.integers(len(_NOISES))](count, rng)
    return sound / _level(sound)


def _voiceless(lesson: Lesson, others: list[Lesson], rng: np.random.Generator) -> Lesson:
    sound = np.zeros(len(lesson.clean))
    if rng.random() < 0.3:
        sound += 10 ** (rng.uniform(-55, -42) / 20) * _babble(others, rng)
    elif rng.random() < 0.2:  # a crowd
        sound += 10 ** (rng.uniform(-42, -30) / 20) * _babble(others, rng, 3)
    if rng.random() < 0.9:
        sound += 10 ** (rng.uniform(-65, -16) / 20) * _noise(len(sound), rng)
    nothing = np.zeros_like(lesson.visemes)
    nothing[:, 0] = 1
    phones, tone = np.zeros_like(lesson.phones), np.zeros_like(lesson.pitch)
    sound, clean = np.clip(sound, -1, 1).astype(np.float32), np.zeros_like(lesson.clean)
    return Lesson(sound, clean, phones, nothing, nothing, tone)


def _noisy(lesson: Lesson, others: list[Lesson], rng: np.random.Generator) -> Lesson:
    wanted = 0.06 * 10 ** (rng.uniform(-30, 10) / 20)
    clean = lesson.clean * np.float32(wanted / max(_level(lesson.clean), 1e-3))
    sound, level = clean.astype(np.float64), _level(clean)
    if rng.random() < 0.75:
        sound += level * 10 ** (-rng.uniform(3, 20) / 20) * _babble(others, rng)
    if rng.random() < 0.35:
        sound += level * 10 ** (-rng.uniform(0, 30) / 20) * _noise(len(sound), rng)
    if rng.random() < 0.5:  # every real microphone hisses
        sound += 10 ** (-rng.uniform(50, 85) / 20) * rng.standard_normal(len(sound))
    if rng.random() < 0.08:
        limit = float(np.abs(sound).max()) * rng.uniform(0.2, 0.7) + 1e-6
        sound = np.clip(sound, -limit, limit)
    noisy = np.clip(sound, -1, 1).astype(np.float32)
    return replace(lesson, noisy=noisy, clean=clean)
