"""Contact sheets: an avatar in the expressions by which faces are judged."""

from collections.abc import Callable, Iterator
from math import radians

import numpy as np
from numpy.typing import NDArray

from render.cameras import portrait
from render.decoder.decoder import Decoder
from render.decoder.identity import Identity
from render.lighting import LIGHTINGS
from render.types import AHEAD, Density, Gaussians, Renderer
from sensors.rotation import from_angles
from sensors.types import HeadPose

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


def _both(**values: float) -> dict[str, float]:
    """Activations of both sides."""
    return {f"{name}_{side}": value for name, value in values.items() for side in "LR"}


BLINK = _both(eyeBlink=1.0)
Pose = tuple[dict[str, float], NDArray[np.float32], float]
# name: activations, gaze, yaw of the camera in degrees
POSES: dict[str, Pose] = {
    "neutral": ({}, AHEAD, 0.0),
    "smile": (SMILE, AHEAD, 0.0),
    "jaw open": ({"jawOpen": 0.6}, AHEAD, 0.0),
    "blink": (BLINK, AHEAD, 0.0),
    "gaze": (LOOK, gaze(20, -6), 0.0),
    "profile": ({}, AHEAD, 65.0),
}
VIEWS: dict[str, Pose] = {f"{yaw}": ({}, AHEAD, float(yaw)) for yaw in (0, 30, 60, 90, 180, -45)}
SPEECH: dict[str, Pose] = {
    "s": ({"jawOpen": 0.05, **_both(mouthStretch=0.3, mouthLowerDown=0.4)}, AHEAD, 0.0),
    "f": ({"jawOpen": 0.06, "mouthRollLower": 0.7, **_both(mouthUpperUp=0.3)}, AHEAD, 0.0),
    "o": ({"jawOpen": 0.3, "mouthFunnel": 0.7}, AHEAD, 0.0),
    "oo": ({"jawOpen": 0.1, "mouthPucker": 0.9, "mouthFunnel": 0.3}, AHEAD, 0.0),
    "ah": ({"jawOpen": 0.55, **_both(mouthLowerDown=0.25)}, AHEAD, 0.0),
    "ee": ({"jawOpen": 0.12, **_both(mouthSmile=0.4, mouthLowerDown=0.4)}, AHEAD, 0.0),
}
EYES: dict[str, Pose] = {
    "half": (_both(eyeBlink=0.5), AHEAD, 0.0),
    "shut": (BLINK, AHEAD, 0.0),
    "up left": (_both(eyeLookUp=0.5), gaze(18, 12), 0.0),
    "up right": (_both(eyeLookUp=0.5), gaze(-18, 12), 0.0),
    "down left": (_both(eyeLookDown=0.5), gaze(18, -12), 0.0),
    "down right": (_both(eyeLookDown=0.5), gaze(-18, -12), 0.0),
}
MOODS: dict[str, Pose] = {
    "happy": ({**SMILE, "jawOpen": 0.12}, AHEAD, 0.0),
    "sad": (_both(mouthFrown=0.7, browInnerUp=0.8, eyeLookDown=0.2), AHEAD, 0.0),
    "angry": (
        {
            **_both(browDown=1.0, noseSneer=0.35, eyeSquint=0.5, mouthPress=0.8, mouthFrown=0.4),
            "mouthShrugLower": 0.3,
        }, AHEAD, 0.0,
    ),
    "surprised": (
        {**_both(browInnerUp=0.9, browOuterUp=0.9, eyeWide=0.8), "jawOpen": 0.3}, AHEAD, 0.0,
    ),
    "disgusted": (_both(noseSneer=0.9, mouthUpperUp=0.6, browDown=0.5), AHEAD, 0.0),
    "afraid": (
        {**_both(browInnerUp=0.9, eyeWide=0.7, mouthStretch=0.5), "jawOpen": 0.15}, AHEAD, 0.0,
    ),
}  # fmt: skip
PORTRAIT: dict[str, Pose] = {"portrait": ({}, AHEAD, 15.0)}
# Degrees: pitch > 0 down, yaw > 0 to the subject's left, roll > 0 to its right shoulder.
HEADS = {
    "left": (0, 30, 0),
    "right": (0, -30, 0),
    "down": (20, 0, 0),
    "up": (-20, 0, 0),
    "right shoulder": (0, 0, 15),
    "left shoulder": (0, 0, -15),
}
SHEETS = {
    "portrait": PORTRAIT,
    "poses": POSES,
    "views": VIEWS,
    "speech": SPEECH,
    "eyes": EYES,
    "moods": MOODS,
}


def code(decoder: Decoder, activations: dict[str, float]) -> NDArray[np.float32]:  # [256]
    rig = np.zeros(len(decoder.rig_names), np.float32)
    for name, value in activations.items():
        rig[decoder.rig_names.index(name)] = value
    return decoder.encode(rig)


def posed(decoder: Decoder, who: Identity, pose: str) -> Gaussians:
    activations, looking, _ = POSES[pose]
    return decoder.decode(code(decoder, activations), looking, who)[1]


def avatar(
    decoder: Decoder, who: Identity, shoot: Shoot, poses: dict[str, Pose] = POSES
) -> list[Picture]:
    """One picture a pose."""
    return [
        shoot(decoder.decode(code(decoder, activations), looking, who)[1], yaw)
        for activations, looking, yaw in poses.values()
    ]


def turned(decoder: Decoder, who: Identity, shoot: Shoot) -> list[Picture]:
    """One picture a pose of the head on its neck, in the order of HEADS."""
    calm = code(decoder, {})
    heads = (
        HeadPose(quat=from_angles((radians(a), radians(b), radians(c))))
        for a, b, c in HEADS.values()
    )
    return [shoot(decoder.decode(calm, AHEAD, who, head)[1], 0.0) for head in heads]


def lights(who: Identity, shoot: Shoot, gaussians: Density) -> list[Picture]:
    """One picture a light, in the order of LIGHTINGS."""
    heads = (Decoder.load(gaussians=gaussians, light=name) for name in LIGHTINGS)
    return [shoot(posed(head, who, "neutral"), 0.0) for head in heads]


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


def around(cloud: Gaussians, renderer: Renderer, size: int, count: int) -> Iterator[Picture]:
    """So many pictures [size, size, 4] from all sides, once around."""
    for index in range(count):
        renderer.draw(cloud, portrait(size, size, yaw_deg=360 * index / count))
        yield renderer.read_rgba()


def grid(pictures: list[Picture], columns: int) -> Picture:
    """At most so many beside each other; the last row of several is filled with what is in the
    first one's corner."""
    columns = min(columns, len(pictures))
    blank = np.full_like(pictures[0], pictures[0][0, 0])
    pictures = pictures + [blank] * (-len(pictures) % columns)
    rows = [np.concatenate(pictures[i : i + columns], 1) for i in range(0, len(pictures), columns)]
    return np.concatenate(rows)
