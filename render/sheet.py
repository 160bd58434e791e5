"""Contact sheets: what an avatar looks like in the expressions people judge a face by."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from render.decoder import Decoder
from render.identity import Identity
from render.types import AHEAD, Gaussians

Picture = NDArray[np.uint8]
Shoot = Callable[[Gaussians, float], Picture]  # a cloud from a yaw of the camera, in degrees


def gaze(yaw_deg: float, pitch_deg: float) -> NDArray[np.float32]:  # [2, 3] unit vectors
    """Both eyes in one direction; yaw > 0 to the subject's left, pitch > 0 up."""
    yaw, pitch = np.radians(yaw_deg), np.radians(pitch_deg)
    one = [np.sin(yaw) * np.cos(pitch), np.sin(pitch), np.cos(yaw) * np.cos(pitch)]
    return np.tile(np.array(one, np.float32), (2, 1))


SMILE = {
    **{f"mouthSmile_{s}": 0.85 for s in "LR"},
    **{f"cheekSquint_{s}": 0.6 for s in "LR"},
    **{f"mouthUpperUp_{s}": 0.35 for s in "LR"},
    **{f"mouthLowerDown_{s}": 0.15 for s in "LR"},
}
LOOK = {"eyeLookOut_L": 0.6, "eyeLookIn_R": 0.6, "eyeLookDown_L": 0.25, "eyeLookDown_R": 0.25}
# name: activations, gaze, yaw of the camera in degrees
POSES: dict[str, tuple[dict[str, float], NDArray[np.float32], float]] = {
    "neutral": ({}, AHEAD, 0.0),
    "smile": (SMILE, AHEAD, 0.0),
    "jaw open": ({"jawOpen": 0.6}, AHEAD, 0.0),
    "blink": ({"eyeBlink_L": 1.0, "eyeBlink_R": 1.0}, AHEAD, 0.0),
    "gaze": (LOOK, gaze(20, -6), 0.0),
    "profile": ({}, AHEAD, 65.0),
}


def code(decoder: Decoder, activations: dict[str, float]) -> NDArray[np.float32]:  # [256]
    rig = np.zeros(len(decoder.rig_names), np.float32)
    for name, value in activations.items():
        rig[decoder.rig_names.index(name)] = value
    return decoder.encode(rig)


def posed(decoder: Decoder, who: Identity, pose: str) -> Gaussians:
    activations, looking, _ = POSES[pose]
    return decoder.decode(code(decoder, activations), looking, who)[1]


def avatar(decoder: Decoder, who: Identity, shoot: Shoot) -> list[Picture]:
    """One picture a pose, in the order of POSES."""
    return [shoot(posed(decoder, who, p), POSES[p][2]) for p in POSES]


def traversals(decoder: Decoder, who: Identity, shoot: Shoot, rows: int = 6) -> list[Picture]:
    """Draws from the prior, then its widest dimensions from -2 to 2 deviations; five a row."""
    coding, rng = decoder.coding, np.random.default_rng(0)
    draws = [decoder.decode(decoder.sample(rng), AHEAD, who)[1] for _ in range(5)]
    out = [shoot(cloud, 0.0) for cloud in draws]
    for dimension in np.argsort(-coding.deviation)[:rows]:
        for amount in (-2.0, -1.0, 0.0, 1.0, 2.0):
            normalised = np.zeros_like(coding.mean)
            normalised[dimension] = amount
            cloud = decoder.decode(coding.code(normalised), AHEAD, who)[1]
            out.append(shoot(cloud, 0.0))
    return out


def grid(pictures: list[Picture], columns: int) -> Picture:
    rows = [np.concatenate(pictures[i : i + columns], 1) for i in range(0, len(pictures), columns)]
    return np.concatenate(rows)
