"""Metrics of the live path: the Driver, tick by tick, on speech, silence and noise."""

# pyright: reportMissingTypeStubs=false

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sensors.types import InputError

if TYPE_CHECKING:
    from encoder.driver import Driver
    from encoder.evaluation.judging import FaceMesh
    from encoder.evaluation.rows import Segment

SOUNDS = (".ogg", ".wav", ".flac")
REST_SECONDS = 60
NOISE_DBFS = -30.0
RATE = 48_000
SHORTEST_S = 1.0  # of a recording


def recordings(folder: Path, what: str) -> list[Path]:
    """Sound files in a folder and below; raise InputError where there are none. what: who asks."""
    paths = sorted(p for p in folder.rglob("*") if p.suffix.lower() in SOUNDS)
    if not paths:
        raise InputError(
            f"{what}: expected {', '.join(SOUNDS)} files in {folder}, got none; "
            "give a folder of recordings"
        )
    return paths


def load_sound(path: Path) -> np.ndarray:  # [T * 1600] f32
    """A sound file as 48 kHz mono, -1..1, cut to whole frames of 1600 samples.

    Raises InputError where it is none, shorter than a second, or holds what is no number."""
    from encoder.capture.subjects.mocap import read_audio

    mono = read_audio(path)
    short = len(mono) < SHORTEST_S * RATE
    if short or not np.isfinite(mono).all():
        got = f"{len(mono) / RATE:.2f} s" if short else "NaN in it"
        raise InputError(f"{path}: expected a sound of 1 s or more, got {got}; leave it out")
    return mono[: len(mono) // 1600 * 1600]


def _too_short(path: Path) -> bool:
    import soundfile

    try:
        return soundfile.info(path).duration < SHORTEST_S
    except soundfile.LibsndfileError:
        return False  # reading it says what is wrong


def drive(driver: "Driver", sound: np.ndarray, seed: int) -> np.ndarray:  # [T, 256]
    """Codes of sound [T * 1600] at 48 kHz."""
    from encoder.offline import drive_clip, sound_frames

    return drive_clip(driver, sound_frames(sound), seed).expression


def live_codes(driver: "Driver", segments: "Sequence[Segment]", seed: int) -> np.ndarray:
    """Codes [S, T, 256] of segments; each clip is driven from its start, with synthesised gaze."""
    import soxr

    rows: list[np.ndarray] = []
    done: dict[int, np.ndarray] = {}
    for segment in segments:
        key = id(segment.clip)
        if key not in done:
            stop = max(s.frames.stop for s in segments if s.clip is segment.clip)
            sound = np.asarray(segment.clip.audio[: stop * 800], np.float32) / 32768
            done[key] = drive(driver, soxr.resample(sound, RATE // 2, RATE), seed)
        rows.append(done[key][segment.frames])
    return np.stack(rows)


def not_speech(seed: int) -> dict[str, np.ndarray]:
    """A minute [n] at 48 kHz of each kind of sound that is not speech, at -30 dBFS RMS (silence:
    zeros)."""
    rng = np.random.default_rng(seed)
    count = REST_SECONDS * RATE
    time = np.arange(count) / RATE
    spectrum = np.fft.rfft(rng.standard_normal(count))
    hz = np.maximum(np.fft.rfftfreq(count, 1 / RATE), 20)
    pink = np.fft.irfft(spectrum / np.sqrt(hz), count)
    fan = np.fft.irfft(spectrum / hz, count) / 30
    fan += 0.3 * sum(np.sin(2 * np.pi * 97 * k * time) / k for k in (1, 2, 3))
    keyboard = np.zeros(count)
    for start in np.cumsum(rng.uniform(0.08, 0.5, 150)) * RATE:
        if start < count - 2400:
            click = rng.standard_normal(2400) * np.exp(-np.arange(2400) / 240)
            keyboard[int(start) : int(start) + 2400] += click
    music = np.zeros(count)
    for beat in range(REST_SECONDS * 2):
        here = slice(beat * RATE // 2, (beat + 1) * RATE // 2)
        fade = np.exp(-4 * (time[here] - time[here.start]))
        for note in rng.choice([0, 3, 5, 7, 10, 12], 3, replace=False):
            music[here] += fade * np.sin(2 * np.pi * 220 * 2 ** (note / 12) * time[here])
    sounds = {"pink": pink, "fan": fan, "keyboard": keyboard, "music": music}
    level = 10 ** (NOISE_DBFS / 20)
    loud = {n: (level * x / np.sqrt((x**2).mean())).astype(np.float32) for n, x in sounds.items()}
    return {"silence": np.zeros(count, np.float32), **loud}


def rest_metrics(driver: "Driver", mesh: "FaceMesh", seed: int) -> dict[str, float]:
    """How far the opening of the lips moves in a minute without speech, mm, after half a second."""
    from encoder.evaluation.metrics import movement_mm

    return {
        f"{name}_60s_movement_mm": movement_mm(mesh.opening_mm(drive(driver, sound, seed)))
        for name, sound in not_speech(seed).items()
    }


def speech_metrics(
    driver: "Driver", mesh: "FaceMesh", folder: Path, every: int, seed: int
) -> dict[str, float]:
    """Correlation of the lips' opening with the loudness of real speech; needs no recorded motion.

    Recordings shorter than a second are left out. Raises InputError where the folder holds no
    sound.
    """
    from encoder.capture.motion.shift import best_shift
    from encoder.evaluation.metrics import envelope

    every_nth = recordings(folder, "eval speech --speech")[::every]
    paths = [path for path in every_nth if not _too_short(path)] or every_nth[:1]
    scores, openings = list[tuple[float, int]](), list[np.ndarray]()
    for path in paths:
        sound = load_sound(path)
        opening = mesh.opening_mm(drive(driver, sound, seed))
        scores.append(best_shift(opening, envelope(sound)))
        openings.append(opening)
    wide = np.percentile(np.concatenate(openings), [5, 50, 95])
    return {
        "lip_envelope_r_mean": float(np.mean([r for r, _ in scores])),
        "lip_envelope_r_worst": float(np.min([r for r, _ in scores])),
        "lip_envelope_shift_frames_median": float(np.median([s for _, s in scores])),
        "lip_opening_p5_mm": float(wide[0]),
        "lip_opening_p50_mm": float(wide[1]),
        "lip_opening_p95_mm": float(wide[2]),
        "recordings": float(len(paths)),
    }


def drift_metrics(
    driver: "Driver", segments: "Sequence[Segment]", truth: np.ndarray, mesh: "FaceMesh", seed: int
) -> dict[str, float]:
    """Lip sync in the first and the tenth minute of one minute of speech played ten times."""
    import soxr

    sound = np.concatenate([segment.audio for segment in segments])[: 24_000 * 60]
    minute = soxr.resample(sound, RATE // 2, RATE).astype(np.float32)
    minute = minute[: len(minute) // 1600 * 1600]
    codes = drive(driver, np.tile(minute, 10), seed)
    ticks = len(minute) // 1600
    real = mesh.lips(truth.reshape(-1, truth.shape[-1])[:ticks])
    first, last = (
        mesh.marks.sync_error_mm(mesh.lips(part), real) for part in (codes[:ticks], codes[-ticks:])
    )
    return {"first_minute_lip_sync_mm": first, "tenth_minute_lip_sync_mm": last}
