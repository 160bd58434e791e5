"""`livedrive eval rest`: how far lips open in sounds that are no voice.

The sounds are made here, from seeds that no training draws; or they are recordings of one's own.
"""

# pyright: reportMissingTypeStubs=false

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from app.eval.settings import EvalSettings
from app.terminal.arguments import File
from app.terminal.thresholds import at_most, finish
from sensors.types import FPS

OPEN_MM = 2.0
DRAWS, SECONDS = 6, 10  # of each kind of sound
LEVELS_DB = (-40.0, -16.0)  # RMS, full scale
UNSEEN = 7_000_000  # trainings draw from seeds far below
SETTLE = FPS // 2  # frames
Kinds = dict[str, Callable[[int, np.random.Generator], np.ndarray]]


@dataclass(frozen=True, kw_only=True)
class RestSettings(EvalSettings):
    """Measure how far lips open in sounds that are no voice."""

    sounds: File = None
    """Folder of recordings (WAV, FLAC, OGG) without a voice, instead of sounds that are made."""
    weights: File = None
    """Folder of the networks; default: the shipped ones."""


def evaluate(settings: RestSettings) -> None:
    """Print the table; exit with status 1 where a threshold is missed."""
    from app.eval.speech.live import drive
    from app.face.mesh import face_mesh
    from encoder.inference import load_driver

    driver, mesh = load_driver(settings.weights, device="cpu"), face_mesh(settings.avatar)
    openings: dict[str, list[np.ndarray]] = {}
    for name, sound in sounds(settings):
        opening = mesh.opening_mm(drive(driver, sound, settings.seed))[SETTLE:]
        openings.setdefault(name, []).append(opening)
    driver.close()
    metrics: dict[str, float] = {}
    for name, found in openings.items():
        opened = np.concatenate(found)
        metrics[f"{name}/open_share"] = round(float((opened > OPEN_MM).mean()), 4)
        metrics[f"{name}/widest_mm"] = round(float(opened.max()), 3)
    bars = [at_most(k, value, 0.02) for k, value in metrics.items() if k.endswith("open_share")]
    finish({"metrics": metrics, "bars": bars, "seed": settings.seed}, settings.report)


def sounds(settings: RestSettings) -> Iterator[tuple[str, np.ndarray]]:
    """Names of kinds and sounds [T * 1600] at 48 kHz."""
    from tqdm import tqdm

    from app.eval.speech.live import load_sound, recordings

    if settings.sounds is None:
        of_kinds = kinds()
        count = len(of_kinds) * DRAWS
        yield from tqdm(made(of_kinds, settings.seed), "sounds", count, mininterval=2)
        return
    paths = recordings(settings.sounds, "eval rest --sounds")
    for path in tqdm(paths, "sounds", mininterval=2):
        yield path.stem, load_sound(path)


def kinds() -> Kinds:
    """Of sounds that are made, by name."""
    from encoder.capture.speech.handling import HANDLING
    from encoder.capture.speech.voice_like import VOICE_LIKE

    return {make.__name__: make for make in (*HANDLING, *VOICE_LIKE)}


def made(kinds: Kinds, seed: int) -> Iterator[tuple[str, np.ndarray]]:
    """Each kind several times, at levels of its own."""
    import soxr

    from encoder.capture.speech.handling import RATE

    for number, (name, make) in enumerate(kinds.items()):
        for draw in range(DRAWS):
            rng = np.random.default_rng([UNSEEN + seed, number, draw])
            level = 10 ** (rng.uniform(*LEVELS_DB) / 20)
            sound = level * make(SECONDS * RATE, rng)
            yield name, soxr.resample(np.clip(sound, -1, 1), RATE, 2 * RATE).astype(np.float32)
