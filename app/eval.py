"""`livedrive eval`: does the mouth follow speech it never heard, and rest when there is none?"""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from tyro.conf import Positional

from sensors.types import InputError

SOUNDS = (".ogg", ".wav", ".flac")
REST_SECONDS = 2
NOISE_DBFS = -50.0


@dataclass(kw_only=True)
class Eval:
    """Judge the encoder on a folder of speech, and on silence and noise."""

    speech: Positional[Path]
    """Folder of speech recordings that were not used in training."""
    avatar: str = "ben"
    seed: int = 0
    device: Literal["auto", "cpu", "cuda"] = "auto"
    every: int = 1
    """Use every n-th recording."""
    report: Path | None = None
    """Write the figures as JSON."""

    def run(self) -> None:
        from tqdm import tqdm

        from app.bars import at_least, at_most, finish
        from encoder.metrics import best_shift, envelope, movement_mm

        paths = sorted(p for p in self.speech.rglob("*") if p.suffix in SOUNDS)[:: self.every]
        if not paths:
            raise InputError(
                f"eval: expected {', '.join(SOUNDS)} files in {self.speech}, got none; "
                "give a folder of speech"
            )
        opening = Opening(self.avatar, self.device, self.seed)
        correlations, shifts = [], []
        for path in tqdm(paths, unit="file", disable=None):
            sound = load_sound(path)
            r, shift = best_shift(opening(sound), envelope(sound))
            correlations.append(r)
            shifts.append(shift)
        rng = np.random.default_rng(self.seed)
        count = (REST_SECONDS * 30) * 1600
        noise = 10 ** (NOISE_DBFS / 20) * rng.standard_normal(count)
        metrics = {
            "lip_envelope_r_mean": float(np.mean(correlations)),
            "lip_envelope_r_worst": float(np.min(correlations)),
            "lip_envelope_shift_frames_median": float(np.median(shifts)),
            "recordings": len(paths),
            "silence_movement_mm": movement_mm(opening(np.zeros(count, np.float32))),
            "noise_movement_mm": movement_mm(opening(noise.astype(np.float32))),
        }
        bars = [
            at_least("lip_envelope_r_mean", metrics["lip_envelope_r_mean"], 0.35),
            at_most("silence_movement_mm", metrics["silence_movement_mm"], 1.0),
            at_most("noise_movement_mm", metrics["noise_movement_mm"], 1.0),
        ]
        if self.report:
            report = {"metrics": metrics, "bars": bars, "seed": self.seed, "avatar": self.avatar}
            self.report.write_text(json.dumps(report, indent=2) + "\n")
        for name, value in metrics.items():
            print(f"{name:36s} {value:.3f}")
        finish(bars)


class Opening:
    """Drives the head with sound alone and measures how far the lips are open, in mm."""

    def __init__(self, avatar: str, device: Any, seed: int) -> None:
        from encoder.inference import load_driver
        from encoder.metrics import inner_lip_pairs
        from render import identity
        from render.decoder import Decoder

        self._seed = seed
        self._who, self._decoder = identity.load(avatar), Decoder.load()
        self._driver = load_driver(device=device)
        self._upper, self._lower = (self._decoder.regions[f"lips_{p}"] for p in ("upper", "lower"))
        rest = self._who.geometry
        self._pairs = inner_lip_pairs(rest[self._upper], rest[self._lower])

    def __call__(self, sound: np.ndarray) -> np.ndarray:  # [T * 1600] -> [T] mm
        from encoder.metrics import lip_opening_mm

        state = self._driver.init_state(self._seed)
        upper, lower = [], []
        for frame in frames(sound):
            driven, state = self._driver.step(frame, state)
            vertices = self._decoder.vertices(driven.expression, driven.gaze, self._who)
            upper.append(vertices[self._upper])
            lower.append(vertices[self._lower])
        return lip_opening_mm(np.array(upper), np.array(lower), self._pairs)


def load_sound(path: Path) -> np.ndarray:  # [T * 1600] f32
    """Any sound file as whole frames of 48 kHz mono."""
    import soundfile
    import soxr

    sound, rate = soundfile.read(path, dtype="float32", always_2d=True)
    mono = soxr.resample(sound.mean(1), rate, 48_000).astype(np.float32)
    return mono[: len(mono) // 1600 * 1600]


def frames(sound: np.ndarray) -> Iterator[Any]:
    """Sound as the frames of a session without eyes."""
    from sensors.types import FPS, NS, SensorFrame

    blind, never = np.zeros(2, bool), np.full(2, -1, np.int64)
    for index, samples in enumerate(sound.reshape(-1, 1600)):
        t_ns = (index + 1) * NS // FPS
        yield SensorFrame(index, t_ns, samples, None, blind, never, audio_gap=False)
