"""Gaussians that nothing shows: behind lids, lips and teeth, whatever a face does.

A Gaussian is hidden where, in all pictures of all people, it has next to no share of any pixel:
its opacity times what those before it let through.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray
from tqdm import tqdm

from render.cameras import portrait
from render.decoder.decoder import Decoder
from render.decoder.identity import Identity
from render.splats import reference
from render.training.data import expressions
from render.types import Camera, Floats, Gaussians

PICTURE_PX = 768
LEAST = 0.02  # of a pixel
AROUND = (
    *((0, 0), (25, 8), (-25, -8), (45, 0), (-45, 0), (70, 10), (-70, 10), (0, 25), (0, -25)),
    *((90, 0), (-90, 0), (125, 0), (-125, 0), (180, 0), (180, 25), (90, -25), (-90, -25)),
)
IN_FRONT, STRAIGHT = AROUND[:9], AROUND[:3]  # yaw and pitch in degrees
GAZES_DEG = (
    *((0, 0), (35, 0), (-35, 0), (0, 25), (0, -25)),
    *((28, 18), (-28, 18), (28, -18), (-28, -18)),
)
TONGUE = "tongueTipUp", "tongueBackUp"  # what a code says beside the rig
# Both sides at once, and what shows depths of a mouth.
POSES: tuple[dict[str, float], ...] = (
    {"jawOpen": 1, "mouthUpperUp": 0.8},
    {"jawOpen": 0.5, "mouthLowerDown": 1, "tongueTipUp": 1},
    {"jawOpen": 0.6, "tongueBackUp": 1},
    {"mouthSmile": 1, "jawOpen": 0.2, "eyeBlink": 1},
    {"eyeWide": 1, "mouthStretch": 1, "jawOpen": 0.5},
    {"mouthLeft": 1, "jawOpen": 0.5, "mouthFunnel": 1},
    {"mouthRight": 1, "jawOpen": 0.5, "mouthFunnel": 1},
    {"mouthUpperUp": 1, "mouthLowerDown": 1},
    {"mouthSmile": 1, "mouthUpperUp": 0.6, "mouthLowerDown": 0.6, "jawOpen": 0.1},
    {"eyeWide": 1, "browInnerUp": 1},
    {"mouthPucker": 1, "jawOpen": 0.3},
    {"eyeSquint": 1, "noseSneer": 1, "mouthUpperUp": 1},
    {"mouthRollLower": 1},
    {"eyeBlink": 0.5},
)


def hidden(decoder: Decoder, people: Sequence[Identity]) -> NDArray[np.intp]:
    """The anchors that none of the people ever shows, in the order of the prior's file;
    `decoder` with all of its Gaussians."""
    rows = np.flatnonzero(decoder.surface.depths == 0)
    unseen = rows[most_shown(decoder, people)[rows] < LEAST]
    return np.sort(decoder.shares[unseen].indices)


def most_shown(decoder: Decoder, people: Sequence[Identity]) -> Floats:  # [n] 0..1
    """The largest share of a pixel that each Gaussian of the head has in any picture."""
    most = np.zeros(len(decoder.surface.depths), np.float32)
    for who in tqdm(people, desc="what is seen", unit="person"):
        for rig, gaze, views in faces(decoder):
            _, cloud = decoder.decode(decoder.encode(rig), gaze, who)
            for view in views:
                camera = portrait(PICTURE_PX, PICTURE_PX, *view)
                np.maximum(most, shares(cloud, len(most), camera), out=most)
    return most


def faces(decoder: Decoder) -> Iterator[tuple[Floats, Floats, Sequence[tuple[float, float]]]]:
    """Rig activations [R], gaze [2, 3], and from where to look at them."""
    names = (*decoder.rig_names, *TONGUE)
    still = np.zeros(len(names), np.float32)
    yield still, expressions.gaze(0, 0), AROUND
    for index, pose in enumerate(POSES):
        rig = still.copy()
        for name, value in pose.items():
            rig[[n.removesuffix("_L").removesuffix("_R") == name for n in names]] = value
        yield rig, expressions.gaze(*GAZES_DEG[index % len(GAZES_DEG)]), IN_FRONT
    wide = np.array([n.startswith("eyeWide") for n in names], np.float32)
    for angles in GAZES_DEG:
        yield wide, expressions.gaze(*angles), STRAIGHT


def shares(cloud: Gaussians, count: int, camera: Camera) -> Floats:  # [count] 0..1
    """The largest share of a pixel that each of the first `count` Gaussians has among them."""
    number = np.repeat(np.arange(count, dtype=np.float32)[:, None], 3, 1)
    first = Gaussians(
        cloud.means[:count], cloud.quats[:count], cloud.scales[:count], cloud.opacities[:count],
        number,
    )  # fmt: skip
    splats = reference.project(first, camera)
    conics = np.linalg.inv(splats.cov)
    most = _blend(
        splats.xy, splats.half_size,
        conics[:, 0, 0], conics[:, 0, 1], conics[:, 1, 1], splats.opacities,
        camera.width, camera.height,
    )  # fmt: skip
    out = np.zeros(count, np.float32)
    out[np.rint(splats.colors[:, 0]).astype(int)] = most
    return out


@njit(cache=True, error_model="numpy")
def _blend(xy, half, a, b, c, opacities, width, height):  # type: ignore[no-untyped-def]
    left, most = np.ones((height, width)), np.zeros(len(a))
    for i in range(len(a)):
        x0, y0 = max(int(xy[i, 0] - half[i, 0]), 0), max(int(xy[i, 1] - half[i, 1]), 0)
        x1 = min(int(xy[i, 0] + half[i, 0]) + 1, width)
        y1 = min(int(xy[i, 1] + half[i, 1]) + 1, height)
        for y in range(y0, y1):
            for x in range(x0, x1):
                dx, dy = x + 0.5 - xy[i, 0], y + 0.5 - xy[i, 1]
                power = 0.5 * (a[i] * dx * dx + c[i] * dy * dy) + b[i] * dx * dy
                alpha = opacities[i] * np.exp(-power)
                if alpha >= reference.MIN_ALPHA:
                    most[i] = max(most[i], alpha * left[y, x])
                    left[y, x] *= 1 - alpha
    return most
