"""Expressions to learn from: single shapes, visemes, moods and frames of a real take."""

from pathlib import Path

import numpy as np

from render import arkit
from render.types import Floats

TRAIN_SHARE = 0.7  # of the real take; the rest of the clip is held out
VISEMES: tuple[dict[str, float], ...] = (
    {"jawOpen": 0.55, "mouthLowerDown": 0.25},
    {"jawOpen": 0.3, "mouthStretch": 0.4, "mouthUpperUp": 0.2, "mouthLowerDown": 0.4},
    {"jawOpen": 0.12, "mouthSmile": 0.35, "mouthUpperUp": 0.3, "mouthLowerDown": 0.5},
    {"jawOpen": 0.3, "mouthFunnel": 0.7},
    {"jawOpen": 0.1, "mouthPucker": 0.9, "mouthFunnel": 0.3},
    {"mouthClose": 0.08, "jawOpen": 0.08, "mouthPress": 0.5, "mouthRollLower": 0.4},
    {"jawOpen": 0.05, "mouthRollLower": 0.7, "mouthUpperUp": 0.3},
    {"jawOpen": 0.15, "tongueTipUp": 1.0, "mouthLowerDown": 0.3},
    {"jawOpen": 0.2, "tongueBackUp": 1.0},
    {"jawOpen": 0.08, "mouthShrugUpper": 0.4, "mouthFunnel": 0.5, "mouthLowerDown": 0.3},
)
MOODS: tuple[dict[str, float], ...] = (
    {},
    {},
    {"mouthSmile": 0.8, "cheekSquint": 0.6, "eyeSquint": 0.4, "mouthDimple": 0.3},
    {"mouthFrown": 0.7, "browInnerUp": 0.7, "mouthShrugLower": 0.4},
    {"browDown": 0.9, "noseSneer": 0.5, "eyeSquint": 0.5, "mouthPress": 0.4},
    {"browInnerUp": 0.9, "browOuterUp": 0.9, "eyeWide": 0.8, "jawOpen": 0.25},
    {"noseSneer": 0.9, "mouthUpperUp": 0.6, "browDown": 0.5},
    {"cheekPuff": 0.8, "mouthPress": 0.4},
)


def set_named(rig: Floats, names: list[str], values: dict[str, float]) -> None:
    """Add activations; a name without side means both sides."""
    for name, value in values.items():
        for full in (name, f"{name}_L", f"{name}_R"):
            if full in names:
                rig[names.index(full)] += value


def draw(
    rng: np.random.Generator, names: list[str], take: Floats
) -> tuple[Floats, Floats]:  # rig [R], gaze [2, 3]
    """One expression; `take` [T, 53] are real frames."""
    rig = np.zeros(len(names), np.float32)
    kind = rng.random()
    if kind < 0.25:
        for _ in range(rng.integers(1, 4)):
            name = names[rng.integers(len(names))]
            both = name[:-2] if name[-2:] in ("_L", "_R") and rng.random() < 0.7 else name
            set_named(rig, names, {both: float(rng.uniform(0.4, 1.0))})
    elif kind < 0.5:
        rig[: take.shape[1]] = take[rng.integers(len(take))]
    else:
        viseme, mood = VISEMES[rng.integers(len(VISEMES))], MOODS[rng.integers(len(MOODS))]
        for values, strength in ((viseme, rng.uniform(0, 1.3)), (mood, rng.uniform(0, 1.2))):
            set_named(rig, names, {k: v * float(strength) for k, v in values.items()})
        rig *= rng.uniform(0.85, 1.15, len(rig))
    if rng.random() < 0.3:
        set_named(rig, names, {"eyeBlink": float(rng.choice([0.3, 0.6, 1.0, 1.0]))})
    yaw, pitch = rng.normal(0, 10), rng.normal(-2, 7)
    set_named(rig, names, lid_follow(yaw, pitch))
    return np.clip(rig, 0, 1), gaze(yaw, pitch)


def lid_follow(yaw_deg: float, pitch_deg: float) -> dict[str, float]:
    """Lids that go with the eyes; yaw > 0 looks to the subject's left."""
    up, down = max(pitch_deg, 0) / 25, max(-pitch_deg, 0) / 25
    left, right = max(yaw_deg, 0) / 30, max(-yaw_deg, 0) / 30
    return {
        "eyeLookUp": up,
        "eyeLookDown": down,
        "eyeLookOut_L": left,
        "eyeLookIn_R": left,
        "eyeLookIn_L": right,
        "eyeLookOut_R": right,
    }


def gaze(yaw_deg: float, pitch_deg: float) -> Floats:  # [2, 3] unit vectors
    yaw, pitch = np.radians(yaw_deg), np.radians(pitch_deg)
    one = [np.sin(yaw) * np.cos(pitch), np.sin(pitch), np.cos(yaw) * np.cos(pitch)]
    return np.tile(np.array(one, np.float32), (2, 1))


def real_take(path: Path | None, names: list[str], held_out: bool) -> Floats:  # [T, 53]
    """Frames of a Live Link Face table, its first part for training; one still frame if none."""
    if path is None:
        return np.zeros((1, len(names)), np.float32)
    weights = arkit.to_rig(arkit.read_live_link(path), names)
    cut = int(len(weights) * TRAIN_SHARE)
    return weights[cut:] if held_out else weights[:cut]
