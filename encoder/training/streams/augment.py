"""Random distortions of clips: noise, other voices, gain, equalisation, pitch, clipping.

Each is applied to a crop with probability p (0.3). Filters are short and smooth, so that no frame
hears later speech.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from encoder.capture.dataset import PACK_RATE, PACK_SAMPLES_PER_FRAME, Clip
from encoder.capture.speech.handling import HANDLING

Noise = Callable[[int, np.random.Generator], np.ndarray]  # [n] of about unit RMS
OTHERS_DB = (3, 26)  # that other voices are below a talker
ON_S, OFF_S, EDGE_S = (0.1, 0.5), (0.05, 0.6), 0.01  # of voices in syllables and pauses


@dataclass(frozen=True, kw_only=True)
class Crop:
    audio: np.ndarray  # [800 T] float32, what the network hears
    clean: np.ndarray  # [800 T] float32, before noise and microphone
    rig: np.ndarray  # [T, 53] float32
    tongue: np.ndarray  # [T, 3] float32
    gaze: np.ndarray  # [T, 2, 3] float32
    phones: np.ndarray  # [T] int64, -1 unknown


def noise(count: int, rng: np.random.Generator) -> np.ndarray:
    """[n] unit RMS, white to brown, sometimes with slow swells."""
    spectrum = np.fft.rfft(rng.standard_normal(count))
    frequency = np.maximum(np.arange(len(spectrum)) / len(spectrum), 2e-3)
    sound = np.fft.irfft(spectrum * frequency ** (-rng.uniform(0, 1)), count)
    if rng.random() < 0.3:
        sound *= 1 + 0.8 * np.sin(np.arange(count) * rng.uniform(0.2, 3) * 2 * np.pi / PACK_RATE)
    return sound / sound.std()


def music(count: int, rng: np.random.Generator) -> np.ndarray:
    """[n] unit RMS: chords of decaying notes on a beat, each piece with its own sound."""
    sound, time = np.zeros(count), np.arange(count) / PACK_RATE
    beat = int(rng.uniform(0.2, 0.8) * PACK_RATE)
    base, decay, overtones = rng.uniform(80, 400), rng.uniform(0, 12), rng.uniform(0, 0.8)
    scale = rng.choice(13, 6, replace=False)
    for start in range(0, count, beat):
        here = slice(start, min(start + beat, count))
        age = time[here] - time[start]
        for note in rng.choice(scale, int(rng.integers(1, 5)), replace=False):
            hz = base * 2 ** (note / 12)
            for k in range(1, 5):
                sound[here] += (
                    overtones ** (k - 1)
                    * np.sin(2 * np.pi * hz * k * age)
                    * np.exp(-decay * k * age)
                )
    return sound / sound.std()


def clicks(count: int, rng: np.random.Generator) -> np.ndarray:
    """[n] unit RMS: keys or knocks, short bursts of noise or of a struck thing."""
    sound, length = 0.01 * rng.standard_normal(count), 2400
    time, decay = np.arange(length), rng.uniform(40, 600)
    ring = np.sin(time * rng.uniform(0.02, 0.5)) * rng.uniform(0, 2)
    for start in np.cumsum(rng.uniform(0.06, 1.2 * rng.uniform(0.2, 1), 400)) * PACK_RATE:
        if start < count - length:
            hit = (rng.standard_normal(length) + ring) * np.exp(-time / decay)
            sound[int(start) : int(start) + length] += rng.uniform(0.3, 1) * hit
    return sound / sound.std()


NOT_SPEECH: tuple[Noise, ...] = (noise, clicks, music, music, *HANDLING, *HANDLING[:2])


def not_speech(
    count: int, rng: np.random.Generator, kinds: tuple[Noise, ...] = NOT_SPEECH
) -> np.ndarray:
    """Sound [n] float32 without a voice, -70 to -14 dBFS; with probability 0.1 silence.

    Mostly rubbing and wind at the microphone, then music: these are nearest to fricatives and
    vowels, and moved the lips most.
    """
    if rng.random() < 0.1:
        return np.zeros(count, np.float32)
    level = 10 ** (rng.uniform(-70, -14) / 20)
    make = kinds[rng.integers(len(kinds))]
    return np.clip(level * make(count, rng), -1, 1).astype(np.float32)


@dataclass(frozen=True)
class Crowd:
    """Makes other people's voices out of clips [n] int16."""

    sounds: list[np.ndarray]

    def talk(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """[count] unit RMS: one to six voices at once, half of the times in syllables."""
        return self._mixed(count, rng, rng.random() < 0.5)

    def in_syllables(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """[count] unit RMS: each of the voices in syllables and pauses of its own."""
        return self._mixed(count, rng, True)

    def _mixed(self, count: int, rng: np.random.Generator, syllables: bool) -> np.ndarray:
        sound = np.zeros(count)
        for _ in range(int(rng.integers(1, 7))):
            voice = self.sounds[rng.integers(len(self.sounds))]
            start = int(rng.integers(max(len(voice) - count, 0) + 1))
            part = np.resize(voice[start : start + count], count).astype(np.float64)
            level = rng.uniform(0.3, 1) / max(float(part.std()), 30.0)
            sound += level * part * (on_and_off(count, rng) if syllables else 1)
        return sound / max(float(sound.std()), 1e-3)


def on_and_off(count: int, rng: np.random.Generator) -> np.ndarray:
    """[count] 0..1: a voice that comes in syllables of ON_S, between pauses of OFF_S."""
    pairs = int(count / PACK_RATE / (ON_S[0] + OFF_S[0])) + 3
    lengths = np.stack([rng.uniform(*ON_S, pairs), rng.uniform(*OFF_S, pairs)], 1).ravel()
    changes = np.cumsum(lengths) - rng.uniform(0, lengths[0] + lengths[1])  # starts anywhere
    moments = np.stack([changes - EDGE_S / 2, changes + EDGE_S / 2], 1).ravel()
    states = np.tile([1.0, 0.0, 0.0, 1.0], pairs)
    rise = np.interp(np.arange(count) / PACK_RATE, moments, states)
    return 0.5 - 0.5 * np.cos(np.pi * rise)


def equalise(audio: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The frequency response of a microphone: tilt, two broad bumps, a limited band."""
    spectrum = np.fft.rfft(audio)
    hz = np.fft.rfftfreq(len(audio), 1 / PACK_RATE)
    octave = np.log2(np.maximum(hz, 20) / 1000)
    gain_db = rng.uniform(-3, 3) * octave
    for _ in range(2):
        centre, width = rng.uniform(-3, 3), rng.uniform(0.4, 1.5)
        gain_db += rng.uniform(-8, 8) * np.exp(-(((octave - centre) / width) ** 2))
    high = 10 ** rng.uniform(np.log10(3400), np.log10(12000))
    gain_db -= 12 * np.maximum(np.log2(np.maximum(hz, 20) / high), 0) * 3
    gain_db -= 12 * np.maximum(np.log2(rng.uniform(30, 250) / np.maximum(hz, 20)), 0)
    return np.fft.irfft(spectrum * 10 ** (gain_db / 20), len(audio))


def room(audio: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """An exponential tail behind the direct sound, which stays at sample 0."""
    length = int(rng.uniform(0.08, 0.35) * PACK_RATE)
    tail = rng.standard_normal(length) * np.exp(-6.9 * np.arange(length) / length)
    tail *= rng.uniform(0.1, 0.5) / np.sqrt((tail**2).sum())
    tail[0] = 1.0
    size = len(audio) + length
    return np.fft.irfft(np.fft.rfft(audio, size) * np.fft.rfft(tail, size), size)[: len(audio)]


def crop(
    clip: Clip, frames: int, rng: np.random.Generator, p: float = 0.3, others: Noise | None = None,
    others_db: tuple[float, float] = OTHERS_DB,
) -> Crop:  # fmt: skip
    """`frames` frames from a random place in `clip`; a short clip is padded with silence.

    Resampling shifts pitch and formants; the motion curves are resampled alike. others: makes other
    voices, which may be heard with it, so many dB below.
    """
    factor = float(rng.uniform(0.84, 1.2)) if rng.random() < p + 0.2 else 1.0
    need = int(np.ceil(frames * factor)) + 1
    start = int(rng.integers(max(clip.num_frames - need, 0) + 1))
    stop = min(start + need, clip.num_frames)
    hop = PACK_SAMPLES_PER_FRAME
    source = clip.audio[start * hop : stop * hop].astype(np.float32) / 32768
    count = frames * hop
    if factor == 1.0:
        clean = np.zeros(count, np.float32)
        clean[: min(count, len(source))] = source[:count]
    else:
        where = np.arange(count) * factor
        clean = np.interp(where, np.arange(len(source)), source, right=0.0).astype(np.float32)
    if clip.truth == "rest" and rng.random() < 0.5:
        clean = not_speech(count, rng)  # more kinds than the capture's
    where = (np.arange(frames) + 1) * factor - 1  # frame k sits at the end of its samples
    rig = _curves(clip.rig[start:stop], where)
    tongue = _curves(clip.tongue[start:stop], where)
    gaze = _curves(clip.gaze[start:stop].reshape(stop - start, 6), where)
    inside = np.round(where).astype(int)
    labels = clip.phones[start:stop].astype(np.int64)
    phones = np.where(inside < len(labels), labels[np.minimum(inside, len(labels) - 1)], 0)
    rig[inside >= len(labels)] = tongue[inside >= len(labels)] = 0
    return Crop(
        audio=distort(clean, rng, p, others, others_db), clean=clean, rig=rig, tongue=tongue,
        gaze=gaze.reshape(-1, 2, 3), phones=phones,
    )  # fmt: skip


def _curves(curves: np.ndarray, where: np.ndarray) -> np.ndarray:
    """Read [n, C] at fractional rows `where`; outside, the nearest row."""
    where = np.clip(where, 0, len(curves) - 1)
    low = np.minimum(where.astype(int), max(len(curves) - 2, 0))
    high = np.minimum(low + 1, len(curves) - 1)
    share = (where - low)[:, None].astype(np.float32)
    return curves[low].astype(np.float32) * (1 - share) + curves[high].astype(np.float32) * share


def distort(
    clean: np.ndarray, rng: np.random.Generator, p: float = 0.3, others: Noise | None = None,
    others_db: tuple[float, float] = OTHERS_DB,
) -> np.ndarray:  # fmt: skip
    """[n] -> [n] float32 in -1..1: room, microphone, other voices, noise, gain, clipping."""
    audio = clean.astype(np.float64)
    if rng.random() < p:
        audio = room(audio, rng)
    if rng.random() < p + 0.1:
        audio = equalise(audio, rng)
    level = max(float(np.sqrt((audio**2).mean())), 1e-4)
    if others and rng.random() < p + 0.3:
        audio = audio + level * 10 ** (-rng.uniform(*others_db) / 20) * others(len(audio), rng)
    if rng.random() < p + 0.1:
        make = noise if rng.random() < 0.5 else NOT_SPEECH[rng.integers(len(NOT_SPEECH))]
        audio = audio + level * 10 ** (-rng.uniform(0, 30) / 20) * make(len(audio), rng)
    elif rng.random() < 0.5:  # every real microphone hisses
        audio = audio + 10 ** (-rng.uniform(50, 80) / 20) * noise(len(audio), rng)
    if rng.random() < p + 0.3:
        audio = audio * 10 ** (rng.uniform(-20, 12) / 20)
    if rng.random() < p / 2:
        peak = max(float(np.abs(audio).max()), 1e-4)
        audio = np.clip(audio, -peak * rng.uniform(0.2, 0.8), peak * rng.uniform(0.2, 0.8))
    return np.clip(audio, -1, 1).astype(np.float32)
