"""Build a data pack: rule-made speech and silence, and real recordings where folders are given.

The command `livedrive capture DIR` calls `build`. Every shard is one job with its own seed, so the
pack is the same for any number of processes.
"""

from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from encoder.capture import mocap
from encoder.capture.channels import RIG_NAMES
from encoder.capture.corpus import sentences
from encoder.capture.dataset import Clip, make_clip, write_manifest, write_shard
from encoder.capture.motion import Style, frame_times, speech_curves, upper_face
from encoder.capture.speech import (
    FLITE_VOICES,
    PHONE_INDEX,
    Espeak,
    Phone,
    Speech,
    speak_flite,
)
from sensors.types import SAMPLE_RATE, SAMPLES_PER_FRAME

_ACCENTS = ("en-us", "en-us", "en", "en-gb-scotland", "en-029", "en-gb-x-rp", "en-gb-x-gbclan")
_VARIANT_NAMES = (
    "f1 f2 f3 f4 f5 m1 m2 m3 m4 m5 m6 m7 m8 adam anika Alicia Andrea Andy Annie belinda benjamin "
    "caleb david ed edward Gene Hugo Jacky john Lee linda Marco Mario max Michael michel miguel "
    "Mike norbert pablo paul pedro quincy rob robert sandro shelby steph travis victor zac "
    "klatt klatt3 iven grandma grandpa"
)
_VARIANTS = tuple(_VARIANT_NAMES.split())
_TEST_VOICES = ("f4", "m5", "kal16")


@dataclass(frozen=True, kw_only=True)
class BuildConfig:
    folder: Path
    flite_minutes: float = 25.0
    espeak_minutes: float = 35.0
    rest_minutes: float = 12.0
    shard_minutes: float = 5.0
    grid: tuple[Path, ...] = ()  # GRID folders: labels.npz, alignments.tsv, audio/
    grid_test: tuple[str, ...] = ()  # speakers or clips kept for the test split
    grid_drop: tuple[str, ...] = ()
    speech: tuple[tuple[Path, float], ...] = ()  # folders of real speech, minutes of each
    sources: tuple[tuple[str, str], ...] = ()  # name and licence of what was added
    processes: int = 2
    seed: int = 0


def _say(text: str, voice: str, espeak: Espeak | None, rng: np.random.Generator) -> Speech:
    if espeak is None:
        return speak_flite(text, voice, rng.uniform(0.75, 1.4), rng.uniform(0.85, 1.3))
    speed, pitch, tone = (int(rng.integers(*r)) for r in ((125, 215), (20, 85), (30, 80)))
    return espeak.speak(text, voice, speed, pitch, tone)


def _join(parts: list[Speech], rng: np.random.Generator) -> Speech:
    """Sentences with pauses of 0.2-1.2 s before, between and after them."""
    audio, phones, start = [], [], 0.0
    for part in [*parts, None]:
        pause = np.zeros(int(rng.uniform(0.2, 1.2) * SAMPLE_RATE), np.float32)
        audio.append(pause)
        phones.append(Phone("pau", start, start + len(pause) / SAMPLE_RATE))
        start += len(pause) / SAMPLE_RATE
        if part is not None:
            audio.append(part.audio)
            phones += [Phone(p.name, p.start + start, p.end + start) for p in part.phones]
            start += len(part.audio) / SAMPLE_RATE
    return Speech(np.concatenate(audio), phones)


def phone_labels(phones: list[Phone], num_frames: int) -> np.ndarray:
    """[T] index of the phone that sounds 20 ms before the frame's time; 0 (silence) where none."""
    times = frame_times(num_frames) - 0.02
    labels = np.zeros(num_frames, np.int64)
    for phone in phones:
        labels[(times >= phone.start) & (times < phone.end)] = PHONE_INDEX[phone.name]
    return labels


def voice_clips(engine: str, minutes: float, seed: int) -> Iterator[Clip]:
    """Rule-made clips of "flite" or "espeak": a new voice, style and text for each."""
    rng = np.random.default_rng([seed, len(engine)])
    espeak = Espeak() if engine == "espeak" else None
    frames = 0
    while frames < minutes * 60 * 30:
        variant = str(rng.choice(_VARIANTS if espeak else FLITE_VOICES))
        voice = f"{rng.choice(_ACCENTS)}+{variant}" if espeak else variant
        texts = sentences(int(rng.integers(1, 4)), int(rng.integers(1 << 31)))
        speech = _join([_say(text, voice, espeak, rng) for text in texts], rng)
        peak = 10 ** (rng.uniform(-12, -1) / 20) / max(float(np.abs(speech.audio).max()), 1e-3)
        audio = speech.audio * peak
        rig, gaze = speech_curves(speech.phones, audio, Style.draw(rng), rng)
        labels = phone_labels(speech.phones, len(rig))
        split = "test" if variant in _TEST_VOICES else "train"
        frames += len(rig)
        yield make_clip(
            audio, rig, gaze, labels, truth="rules", voice=f"{engine}-{voice}", split=split
        )


def _coloured(count: int, slope: float, rng: np.random.Generator) -> np.ndarray:
    """Noise of power ~ f^-slope, unit RMS."""
    spectrum = np.fft.rfft(rng.standard_normal(count))
    spectrum *= np.maximum(np.arange(len(spectrum)) / len(spectrum), 1e-3) ** (-slope / 2)
    noise = np.fft.irfft(spectrum, count)
    return noise / noise.std()


def _not_speech(kind: str, seconds: float, rng: np.random.Generator) -> np.ndarray:
    """[n] at 48 kHz: what a microphone hears when nobody speaks."""
    count = int(seconds * SAMPLE_RATE)
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


def rest_clips(minutes: float, seed: int) -> Iterator[Clip]:
    """Silence, noise, breath, hum and clicks: the lips rest, eyes and lids go on."""
    rng = np.random.default_rng([seed, 99])
    frames = 0
    while frames < minutes * 60 * 30:
        kind = str(rng.choice(["zero", "noise", "noise", "breath", "hum", "clicks"]))
        audio = np.clip(_not_speech(kind, float(rng.uniform(4, 9)), rng), -1, 1)
        num_frames = len(audio) // SAMPLES_PER_FRAME
        upper, gaze = upper_face(np.zeros(num_frames), rng)
        frames += num_frames
        yield make_clip(
            audio, upper.reshape(-1, len(RIG_NAMES)), gaze, np.zeros(num_frames),
            truth="rest", voice=f"rest-{kind}",
        )  # fmt: skip


def _grid(folder: Path, test: set[str], drop: set[str]) -> Iterator[Clip]:
    yield from mocap.grid_clips(folder, test, drop)


def _real(folder: Path, minutes: float) -> Iterator[Clip]:
    frames = 0
    for path in sorted(folder.glob("*.ogg")):
        clip = mocap.speech_clip(path, f"{folder.name}-{path.name.split('-')[0].split('_')[0]}")
        frames += clip.num_frames
        yield clip
        if frames > minutes * 60 * 30:
            return


def _job(path: Path, make: Callable[..., Iterator[Clip]], arguments: tuple) -> dict[str, Any]:
    return write_shard(path, list(make(*arguments)))


def _jobs(config: BuildConfig) -> Iterator[tuple[Callable[..., Iterator[Clip]], tuple]]:
    for folder in config.grid:
        yield _grid, (folder, set(config.grid_test), set(config.grid_drop))
    for folder, minutes in config.speech:
        yield _real, (folder, minutes)
    minutes = {"flite": config.flite_minutes, "espeak": config.espeak_minutes}
    for engine, total in minutes.items():
        count = int(np.ceil(total / config.shard_minutes))
        for index in range(count):
            yield voice_clips, (engine, total / count, config.seed + index)
    yield rest_clips, (config.rest_minutes, config.seed)


def build(config: BuildConfig) -> Path:
    """Make the pack with `config.processes` processes; returns its folder."""
    config.folder.mkdir(parents=True, exist_ok=True)
    with ProcessPoolExecutor(config.processes) as pool:
        futures = [
            pool.submit(_job, config.folder / f"shard_{i:03d}.npz", make, arguments)
            for i, (make, arguments) in enumerate(_jobs(config))
        ]
        shards = [f.result() for f in tqdm(futures, desc="capture", unit="shard")]
    sources = {"flite, espeak-ng and noise": "made by rules", **dict(config.sources)}
    write_manifest(config.folder, shards, sources)
    return config.folder
