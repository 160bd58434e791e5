"""Handling noise of a headset's microphone: hands, cloth, wind and taps.

All at 24 kHz with about unit RMS, each drawn anew. Strokes are broad noise whose colour and
loudness follow the speed of a hand; friction sticks and slips, so that it hums; wind is turbulence
at the capsule, below a few hundred hertz; a tap is a thump and what it sets ringing.
"""

from collections.abc import Callable

import numpy as np

RATE = 24_000


def unit(sound: np.ndarray) -> np.ndarray:
    """At a deviation of 1."""
    return sound / max(float(sound.std()), 1e-9)


def coloured(
    count: int,
    slope: float,
    low_hz: float,
    high_hz: float,
    rng: np.random.Generator,
    edges: int = 4,
) -> np.ndarray:
    """[n] noise of power f^-slope between two edges, the steeper the larger `edges`."""
    spectrum = np.fft.rfft(rng.standard_normal(count))
    hz = np.maximum(np.fft.rfftfreq(count, 1 / RATE), 10)
    shape = hz ** (-slope / 2) / (1 + (low_hz / hz) ** edges) / (1 + (hz / high_hz) ** edges)
    return unit(np.fft.irfft(spectrum * shape, count))


def _strokes(count: int, rate_hz: float, rng: np.random.Generator) -> np.ndarray:
    """[n] speed of a hand that goes to and fro, 0..1; no two strokes alike, some left out."""
    speed, start = np.zeros(count), 0
    while start < count:
        length = int(RATE / rate_hz * rng.uniform(0.5, 1.6))
        stop = min(start + length, count)
        hump = np.sin(np.pi * np.arange(stop - start) / length) ** rng.uniform(0.5, 2)
        speed[start:stop] = hump * rng.uniform(0.3, 1) * (rng.random() < 0.85)
        start = stop + int(RATE * rng.exponential(0.08) * (rng.random() < 0.4))
    return speed


def wander(count: int, hz: float, rng: np.random.Generator) -> np.ndarray:
    """[n] a curve of unit deviation that changes about so often."""
    points = max(int(2 * hz * count / RATE) + 4, 5)
    places = np.linspace(0, points - 1, count)
    return unit(np.interp(places, np.arange(points), rng.standard_normal(points)))


def crackle(count: int, per_second: float, rng: np.random.Generator) -> np.ndarray:
    """[n] so many small snaps, all of one material."""
    sound = np.zeros(count)
    number = rng.poisson(per_second * count / RATE)
    sound[rng.integers(count, size=number)] = rng.standard_normal(number) * rng.exponential(
        1, number
    )
    kernel = np.exp(-np.arange(200) / rng.uniform(5, 60)) * np.cos(
        np.arange(200) * rng.uniform(0.05, 1.5)
    )
    return np.convolve(sound, kernel)[:count]


def resonating(
    sound: np.ndarray,  # [n]
    beside: float,  # what is left far from all resonances
    highest: float,  # log10 of Hz
    widths: tuple[float, float],  # over their frequency
    rng: np.random.Generator,
) -> np.ndarray:
    """[n] through one to four resonances."""
    spectrum, hz = np.fft.rfft(sound), np.fft.rfftfreq(len(sound), 1 / RATE)
    shape = np.full(len(hz), beside)
    for _ in range(int(rng.integers(1, 5))):
        centre, width = 10 ** rng.uniform(2.2, highest), rng.uniform(*widths)
        shape += rng.uniform(0.2, 1) / (1 + ((hz - centre) / (width * centre)) ** 2)
    return np.fft.irfft(spectrum * shape, len(sound))


def rub(count: int, rng: np.random.Generator) -> np.ndarray:
    """[n] a hand or cloth over the microphone."""
    speed = _strokes(count, rng.uniform(0.8, 7), rng)
    low, high = rng.uniform(20, 400), 10 ** rng.uniform(2.8, 4.0)
    dull = coloured(count, rng.uniform(0, 2), low, 0.5 * high, rng)
    bright = coloured(count, rng.uniform(0, 1.5), low, high, rng)
    sound = speed * (dull * (1 - speed) + bright * speed)
    return unit(sound) + rng.uniform(0, 0.8) * unit(
        speed * crackle(count, rng.uniform(20, 400), rng) + 1e-4 * dull
    )


def friction(count: int, rng: np.random.Generator) -> np.ndarray:
    """[n] a surface that sticks and slips: a buzz that follows the stroke, through resonances."""
    speed = _strokes(count, rng.uniform(0.5, 4), rng)
    rate_hz = (
        rng.uniform(40, 500) * (0.6 + 0.8 * speed) * (1 + 0.15 * coloured(count, 1, 0.5, 30, rng))
    )
    phase = np.cumsum(rate_hz) / RATE
    slip = np.where(np.mod(phase, 1) < rng.uniform(0.05, 0.5), 1.0, 0.0)
    slip = np.diff(slip, prepend=0) + rng.uniform(0.1, 1.5) * rng.standard_normal(count)
    return unit(resonating(speed * slip, 0.05, 3.8, (0.05, 0.6), rng))


def wind(count: int, rng: np.random.Generator) -> np.ndarray:
    """[n] gusts, slow ones and those as quick as syllables: rumble, and a little hiss when they are
    strong; some overload the microphone."""
    gust = np.abs(wander(count, 10 ** rng.uniform(-0.7, 1.2), rng)) ** rng.uniform(0.5, 2.5)
    gust = gust + rng.uniform(0, 0.3)
    if rng.random() < 0.5:
        gust = gust * (0.2 + np.abs(wander(count, 10 ** rng.uniform(-0.8, 0.3), rng)))
    low, high = 10 ** rng.uniform(0.7, 2.1), 10 ** rng.uniform(2, 3.2)
    edges = 4 if rng.random() < 0.5 else 12
    rumble = coloured(count, rng.uniform(0, 3), low, high, rng, edges)
    hiss = coloured(count, 0.5, 300, 4000, rng)
    sound = unit(gust * rumble + rng.uniform(0, 0.15) * gust**2 * hiss)
    return np.clip(sound, -2, 2) if rng.random() < 0.3 else sound


def taps(count: int, rng: np.random.Generator) -> np.ndarray:
    """[n] fingers, a cable or a table against the headset."""
    sound = 0.003 * coloured(count, 1, 20, 8000, rng)
    time, start = np.arange(int(0.3 * RATE)) / RATE, 0.0
    thump_hz, ring_hz, gap_s = (
        rng.uniform(40, 350),
        10 ** rng.uniform(2.5, 3.7),
        rng.uniform(0.1, 1.2),
    )
    while (start := start + gap_s * rng.uniform(0.3, 1.7)) * RATE < count - len(time):
        thump = np.sin(2 * np.pi * thump_hz * rng.uniform(0.9, 1.1) * time) * np.exp(
            -time * rng.uniform(15, 90)
        )
        ring = np.sin(2 * np.pi * ring_hz * time) * np.exp(-time * rng.uniform(30, 300))
        click = rng.standard_normal(len(time)) * np.exp(-time * rng.uniform(100, 2000))
        hit = thump + rng.uniform(0, 0.5) * ring + rng.uniform(0, 0.8) * click
        first = int(start * RATE)
        sound[first : first + len(time)] += rng.uniform(0.2, 1) * hit
    return unit(sound)


HANDLING: tuple[Callable[[int, np.random.Generator], np.ndarray], ...] = (rub, friction, wind, taps)
