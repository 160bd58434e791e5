"""Sounds that come near a voice and are none: machines, played notes, signals, crackling cloth.

All at 24 kHz with about unit RMS, each drawn anew. They have harmonics, resonances or the rhythm of
syllables, as vowels have; so the network that hears voices has to have heard them.
"""

from collections.abc import Callable

import numpy as np

from encoder.capture.speech.handling import RATE, coloured, crackle, resonating, unit, wander

CURVE_HZ = 500  # at which slow curves are drawn
OVERTONES, HIGHEST_HZ = 24, 9000.0


def buzz(count: int, rng: np.random.Generator) -> np.ndarray:
    """[n] drills, shavers, fans and motors: a hum that wanders, switched on and off or beating."""
    base_hz, drift = 10 ** rng.uniform(1.5, 2.75), rng.uniform(0, 0.15)
    hz = base_hz * np.clip(1 + drift * wander(count, 10 ** rng.uniform(-0.7, 0.9), rng), 0.3, 2)
    sound = unit(_through_a_body(_harmonics(hz, rng.uniform(0.2, 1.6), rng), rng))
    sound += rng.uniform(0, 0.8) * coloured(count, rng.uniform(0, 2), 100, 6000, rng)
    if rng.random() < 0.6:
        on_s, off_s = 10 ** rng.uniform(-1, 0.5), 10 ** rng.uniform(-1.3, 0.3)
        sound *= _switched(count, on_s, off_s, rng)
    if rng.random() < 0.3:
        beat_hz = rng.uniform(3, 30)
        sound *= 1 + 0.8 * np.sin(2 * np.pi * beat_hz * np.arange(count) / RATE)
    return unit(sound)


def played(count: int, rng: np.random.Generator) -> np.ndarray:
    """[n] one to three bowed or blown instruments: notes that glide, swell and tremble."""
    sound = np.zeros(count)
    for _ in range(int(rng.integers(1, 4))):
        pitch, loudness = _melody(count, rng)
        trembling = rng.uniform(0, 0.025) * np.sin(
            2 * np.pi * rng.uniform(4, 7) * np.arange(count) / RATE
        )
        tone = _harmonics(pitch * (1 + trembling), rng.uniform(0.4, 2), rng)
        sound += loudness * unit(_through_a_body(tone, rng))
    return unit(sound)


def beeps(count: int, rng: np.random.Generator) -> np.ndarray:
    """[n] signals: one to three tones that come again and again."""
    time, sound = np.arange(count) / RATE, 1e-3 * rng.standard_normal(count)
    for _ in range(int(rng.integers(1, 4))):
        every_s, share = 10 ** rng.uniform(-0.7, 0.4), rng.uniform(0.05, 0.7)
        on = (time + rng.uniform(0, every_s)) % every_s < every_s * share
        sound += on * np.sin(2 * np.pi * 10 ** rng.uniform(2.5, 3.6) * time)
    return unit(sound)


def crackling(count: int, rng: np.random.Generator) -> np.ndarray:
    """[n] paper, foil or a sleeve that is crumpled, in bursts."""
    bursts = _switched(count, 0.3, 0.3, rng) + 0.02
    sound = bursts * crackle(count, 10 ** rng.uniform(1, 2.7), rng)
    return unit(sound + 1e-3 * coloured(count, 1, 100, 6000, rng))


def _melody(count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """[n] Hz and [n] loudness 0..1 of notes of .1 to 1.6 s, one after another."""
    points = count * CURVE_HZ // RATE + 2
    octaves, loudness, start = np.zeros(points), np.zeros(points), 0
    while start < points:
        length = int(CURVE_HZ * 10 ** rng.uniform(-1, 0.2))
        here = slice(start, start + length)
        octaves[here] = rng.integers(-7, 13) / 12
        done = np.arange(len(octaves[here])) / length
        swell = np.minimum(done / rng.uniform(0.02, 0.3), 1) * (1 - done) ** rng.uniform(0, 1)
        loudness[here] = swell * rng.uniform(0.4, 1) * (rng.random() < 0.9)
        start += length
    glide = np.ones(int(rng.integers(2, 40)))
    octaves = np.convolve(octaves, glide / len(glide), "same")
    return 10 ** rng.uniform(1.8, 2.9) * 2 ** _stretched(octaves, count), _stretched(
        loudness, count
    )


def _harmonics(hz: np.ndarray, slope: float, rng: np.random.Generator) -> np.ndarray:
    """[n] Hz -> [n] a tone whose overtones fall as their number to the power of -slope."""
    phase, sound = 2 * np.pi * np.cumsum(hz) / RATE, np.zeros(len(hz))
    number = np.arange(1, 1 + min(OVERTONES, max(int(HIGHEST_HZ / np.median(hz)), 1)))
    if rng.random() < 0.25:
        number = number[::2]
    for k in number:
        sound += k**-slope * rng.uniform(0.4, 1) * np.sin(k * phase + rng.uniform(0, 2 * np.pi))
    return sound


def _through_a_body(sound: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return resonating(sound, rng.uniform(0.02, 0.3), 3.7, (0.1, 0.8), rng)


def _switched(count: int, on_s: float, off_s: float, rng: np.random.Generator) -> np.ndarray:
    """[n] 0..1: on and off for about so long, with soft edges."""
    points = count * CURVE_HZ // RATE + 2
    loudness, start = np.zeros(points), 0
    while start < points:
        length = 1 + int(CURVE_HZ * rng.exponential(on_s))
        loudness[start : start + length] = rng.uniform(0.3, 1)
        start += length + int(CURVE_HZ * rng.exponential(off_s))
    edge = np.ones(int(rng.integers(2, 50)))
    return _stretched(np.convolve(loudness, edge / len(edge), "same"), count)


def _stretched(curve: np.ndarray, count: int) -> np.ndarray:
    return np.interp(np.arange(count) * (CURVE_HZ / RATE), np.arange(len(curve)), curve)


VOICE_LIKE: tuple[Callable[[int, np.random.Generator], np.ndarray], ...] = (
    buzz, played, beeps, crackling,
)  # fmt: skip
