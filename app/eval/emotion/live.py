"""The emotions on the live path: intensity, switching from one to another, and their cost."""

# pyright: reportMissingTypeStubs=false

import time
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from app.eval.emotion.metrics import EmotionEvaluation

if TYPE_CHECKING:
    from encoder.driver import Driver
    from encoder.evaluation.emotion_sets import EmotionTruth

Metrics = dict[str, float]
Floats = NDArray[np.float32]
INTENSITIES = (0.0, 0.25, 0.5, 0.75, 1.0)
HOLD_FRAMES = 30  # of each emotion before the next one
SWITCHED = 12  # takes with changing emotions


def live_metrics(evaluated: EmotionEvaluation) -> Metrics:
    """Intensity, switching and cost on the live path as it ships (int8)."""
    from encoder import inference

    driver = inference.load_driver(evaluated.weights, "cpu")
    takes = {id(t.segment.clip): t for t in evaluated.truths["neutral voice"]}  # each once
    longest = sorted(takes.values(), key=lambda t: -t.segment.clip.num_frames)
    sounds = [sound_of(take) for take in longest[:SWITCHED]]
    return (
        _intensity_metrics(evaluated, driver, sounds[0][: 1600 * 150])
        | _switching_metrics(evaluated, driver, sounds)
        | {"emotion_cpu_ms_a_tick": emotion_cost_ms(driver, sounds[0])}
    )


def _intensity_metrics(evaluated: EmotionEvaluation, driver: "Driver", sound: Floats) -> Metrics:
    assert driver.emotions is not None
    face, seed = evaluated.regions["face"], evaluated.settings.seed
    calm = drive(driver, sound, "", seed)
    lids = [evaluated.decoder.rig_names.index(f"eyeBlink_{side}") for side in "LR"]
    monotone, halves, zero, apart = 0, list[float](), 0.0, 0.0
    for label in driver.emotions.labels:
        rows = [drive(driver, sound, f"{label}:{i}", seed) for i in INTENSITIES]
        zero = max(zero, float(np.abs(rows[0] - calm).max()))
        sides = evaluated.decoder.rig(rows[-1])[:, lids]
        apart = max(apart, float(np.quantile(np.abs(np.diff(sides)), 0.95)))
        way = np.stack([(face(row) - face(calm))[15:].mean(0) for row in rows])
        end = way[-1] / np.linalg.norm(way[-1])
        along = (way * end).sum((1, 2))  # mm, along the full emotion
        monotone += bool((np.diff(along) > 0).all())
        halves.append(float(along[2] / along[-1]))
    return {
        "intensity_0_difference": zero,
        "intensity_monotone_share": monotone / len(driver.emotions.labels),
        "intensity_half_least": min(halves),
        "intensity_half_most": max(halves),
        "lids_apart_p95": apart,  # of a blink, of the emotion where it is largest
    }


def _switching_metrics(
    evaluated: EmotionEvaluation, driver: "Driver", sounds: list[Floats]
) -> Metrics:
    """Largest movement between frames while one emotion fades into another, compared with the same
    speech without a fade: neutral, and at the same frames in either emotion (excited lips open
    faster)."""
    from encoder.emotion.control import FADE_FRAMES
    from encoder.evaluation.emotion import largest_moves

    assert driver.emotions is not None
    rng, seed, face = np.random.default_rng(evaluated.settings.seed), 0, evaluated.regions["face"]
    neutral, fades, steady = list[Floats](), list[Floats](), list[Floats]()
    for sound in sounds:
        frames = len(sound) // 1600
        names = rng.choice(driver.emotions.labels, frames // HOLD_FRAMES + 1).tolist()
        before, now = (
            np.repeat(words, HOLD_FRAMES)[1:frames] for words in (["", *names[:-1]], names)
        )

        def moves(words: "str | list[str]", sound: Floats = sound) -> Floats:
            return largest_moves(drive(driver, sound, words, seed), face)

        held = {name: moves(name) for name in {"", *names}}
        fading = np.arange(1, frames) % HOLD_FRAMES < FADE_FRAMES
        fades.append(moves([names[0], *now.tolist()])[fading])
        neutral.append(held[""][FADE_FRAMES:])
        steady += [held[name][fading & ((before == name) | (now == name))] for name in held]
    most, usual, steadily = (float(np.concatenate(x).max()) for x in (fades, neutral, steady))
    return {
        "switching_jump_mm": most,
        "normal_jump_mm": usual,
        "steady_jump_mm": steadily,
        "switching_jump_over_normal": most / usual,
        "switching_jump_over_steady": most / steadily,
    }


def sound_of(take: "EmotionTruth") -> Floats:  # [T * 1600] at 48 kHz, 20 s at most
    import soxr

    sound = np.asarray(take.segment.clip.audio[: 800 * 600], np.float32) / 32768
    return soxr.resample(sound, 24_000, 48_000)[: len(sound) // 800 * 1600]


def drive(driver: "Driver", sound: Floats, words: "str | list[str]", seed: int) -> Floats:
    """Codes [T, 256] of sound [T * 1600] at 48 kHz; words: one emotion, or one for each frame."""
    from encoder.offline import drive_clip, sound_frames

    return drive_clip(driver, sound_frames(sound, words), seed).expression


def emotion_cost_ms(driver: "Driver", sound: Floats, rounds: int = 4) -> float:
    """CPU time that a fading mixture of emotions adds to a tick, ms: the fastest of several rounds
    with it minus the fastest without."""
    names = [f"{a}:0.5+{b}:0.5" for a, b in (("happy", "sad"), ("angry", "bored"))]
    mixed = [names[(k // 10) % 2] for k in range(len(sound) // 1600)]
    spent: dict[bool, list[float]] = {True: [], False: []}
    for _ in range(rounds):
        for feels in (False, True):
            start = time.process_time()
            drive(driver, sound, mixed if feels else "", 0)
            spent[feels].append((time.process_time() - start) / len(mixed) * 1000)
    return max(min(spent[True]) - min(spent[False]), 0.0)
