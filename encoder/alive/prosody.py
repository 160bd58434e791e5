"""Accents of speech from sound, causally: pitch and loudness, and nothing drawn at random.

Where: Driver.step -> Alive.step -> Prosody.step. An accent is where pitch and loudness together
rise above what this voice has done in the last seconds; Cave et al. (1996, "About the relationship
between eyebrow movements and F0 variations") found brows to rise with 71 % of the rises of F0.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, log10, sqrt

import numpy as np

from encoder.types import Floats
from sensors.types import FPS, SAMPLE_RATE

DECIMATION = 6  # 48 kHz -> 8 kHz, by means of so many samples: pitch needs no more
RATE = SAMPLE_RATE // DECIMATION
WINDOW = 400  # samples at 8 kHz: 50 ms, four periods of the deepest voice
LOWEST_HZ, HIGHEST_HZ = 70.0, 400.0
SHORTEST, LONGEST = int(RATE / HIGHEST_HZ), int(RATE / LOWEST_HZ)  # lags, in samples
OVERLAP = 1 - np.arange(SHORTEST, LONGEST) / WINDOW  # share of the window that a lag compares
VOICED = 0.45  # of the autocorrelation at lag 0
SILENT_DB = -50.0
SPEECH_DB = 12.0  # above the quietest of the last seconds
FLOOR_RISE_DB = 0.05  # a frame by which the quietest is forgotten
SLOW = exp(-1 / (3.0 * FPS))  # of a voice's mean and spread: three seconds
QUICK = exp(-1 / (0.06 * FPS))
LEAST_DB, LEAST_OCTAVES = 3.0, 0.12  # spread below which a voice counts as even
THRESHOLD = 1.3  # of the score, in spreads
REFRACTORY = int(0.33 * FPS)  # frames from one accent to the next: stressed syllables
PAUSE = int(0.45 * FPS)  # frames of silence after which a turn of speech ends


@dataclass(frozen=True, eq=False)
class ProsodyState:
    """State between frames, a value."""

    tail: Floats  # [WINDOW] at 8 kHz
    floor_db: float = -60.0
    loudness: float = 0.0  # smoothed, 0..1
    mean_db: float = -30.0
    spread_db: float = 6.0
    mean_octave: float = 7.2
    spread_octave: float = 0.25
    score: float = 0.0  # of the frame before
    since_accent: int = 10 * FPS  # frames
    silence: int = 10 * FPS  # frames
    speech: int = 0  # frames of the present turn


@dataclass(frozen=True)
class Prosody:
    """One frame of it."""

    loudness: float  # 0..1
    accent: float  # 0: none begins here, else its strength up to 1
    speaking: bool
    begins: bool  # a turn of speech
    ends: bool


def init_state() -> ProsodyState:
    return ProsodyState(np.zeros(WINDOW, np.float32))


def step(audio: Floats, state: ProsodyState) -> tuple[Prosody, ProsodyState]:  # [1600] -1..1
    """The prosody of a frame, from the sound up to its end. NaN counts as silence."""
    sound = np.minimum(np.maximum(audio, np.float32(-1)), np.float32(1))
    sound = np.where(np.isfinite(audio), sound, np.float32(0))
    low = sound[: len(sound) // DECIMATION * DECIMATION].reshape(-1, DECIMATION)
    low = np.add.reduce(low, 1) / np.float32(DECIMATION)  # `mean`, in half its time
    tail = np.concatenate([state.tail, low])[-WINDOW:]
    power = float(np.add.reduce(sound * sound, dtype=np.float64)) / len(sound)
    level_db = 10 * log10(power + 1e-9)
    floor_db = min(state.floor_db + FLOOR_RISE_DB, max(level_db, -70.0))
    is_speech = level_db > max(floor_db + SPEECH_DB, SILENT_DB)
    octave = _octave(tail) if is_speech else None

    wanted = min(max((level_db - floor_db) / 40.0, 0.0), 1.0) if is_speech else 0.0
    loudness = QUICK * state.loudness + (1 - QUICK) * wanted
    score, mean_octave, spread_octave = 0.0, state.mean_octave, state.spread_octave
    mean_db, spread_db = state.mean_db, state.spread_db
    if is_speech:
        score = (level_db - mean_db) / max(spread_db, LEAST_DB)
        mean_db, spread_db = _followed(level_db, mean_db, spread_db)
    if octave is not None:
        score += (octave - mean_octave) / max(spread_octave, LEAST_OCTAVES)
        mean_octave, spread_octave = _followed(octave, mean_octave, spread_octave)
    since, accent = state.since_accent + 1, 0.0
    if octave is not None and score > THRESHOLD >= state.score and since >= REFRACTORY:
        since, accent = 0, min(0.3 + 0.35 * (score - THRESHOLD), 1.0)

    silence = 0 if is_speech else state.silence + 1
    speaking = silence < PAUSE
    speech = state.speech + 1 if speaking else 0
    prosody = Prosody(
        loudness=loudness,
        accent=accent,
        speaking=speaking,
        begins=speech == 1,
        ends=silence == PAUSE,
    )
    return prosody, ProsodyState(
        tail=tail,
        floor_db=floor_db,
        loudness=loudness,
        mean_db=mean_db,
        spread_db=spread_db,
        mean_octave=mean_octave,
        spread_octave=spread_octave,
        score=score,
        since_accent=since,
        silence=silence,
        speech=speech,
    )


def _followed(value: float, mean: float, spread: float) -> tuple[float, float]:
    """Mean and spread of the last seconds, with one more value."""
    variance = SLOW * spread * spread + (1 - SLOW) * (value - mean) ** 2
    return SLOW * mean + (1 - SLOW) * value, sqrt(variance)


def _octave(tail: Floats) -> float | None:  # [WINDOW] at 8 kHz
    """log2 of the pitch in Hz; None where there is no voice."""
    centred = tail - tail.mean()
    spectrum = np.fft.rfft(centred, 2 * WINDOW)
    correlation = np.fft.irfft(spectrum * spectrum.conj())[:WINDOW]
    unbiased = correlation[SHORTEST:LONGEST] / OVERLAP
    lag = int(unbiased.argmax())
    if correlation[0] <= 0 or unbiased[lag] < VOICED * correlation[0]:
        return None
    return float(np.log2(RATE / (SHORTEST + lag)))
