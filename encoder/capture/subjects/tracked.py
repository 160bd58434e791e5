"""A face tracker's curves as the rig's: neutral, size and time.

Between the readers of tracked motion (mocap.py) and the rules that complete it (articulation.py).
"""

import numpy as np

from encoder.capture.motion.articulation import opening
from encoder.capture.motion.channels import (
    JAW_OPEN,
    MOUTH_CLOSE,
    RIG_INDEX,
    RIG_NAMES,
    SPEECH_COLUMNS,
    from_arkit,
)
from encoder.capture.motion.closures import closing_weight
from encoder.capture.motion.rules import frame_times
from sensors.types import SAMPLES_PER_FRAME

JAW_LOUD = 0.34  # every speaker's 98th percentile of jawOpen is scaled to this
SHUT_SHARE = 0.1  # of a speaker's frames show lips that are shut: their pose is the neutral one
# When a label of frame j is true, in seconds after j / fps. Two witnesses: the middle of the
# exposure, 20 ms, less the 12 to 20 ms that the tracker lags in video mode; and the burst of p in
# 234 clips of GRID s1, before which the labelled lips part 0 to 5 ms early. FACEGOOD: a linear map
# from phones to GRID's lips follows its curves best with 10 to 15 ms.
LABEL_LATE_S = 0.010
# A tracker names s, z, iy and eh by channels that it hardly moves (98th percentiles of .001 to .1),
# and opens the mouth by the jaw alone: a dark hole where people show teeth. These are brought to
# people's size, whose 98th percentiles are about so, with at most so much gain.
LIPS_LOUD = {"mouthLowerDown": 0.5, "mouthUpperUp": 0.4, "mouthStretch": 0.35, "mouthFunnel": 0.2}
LIPS_MOST = 40.0
PUCKER_LOUD, PUCKER_MOST = 0.5, 2.0
JAW_LEAST = 0.45  # of the jaw's opening, that the lips do not take over
LIP_OPENERS = ("mouthLowerDown", "mouthUpperUp", "mouthFunnel")
# Channels whose tracker output says little about the lips (it drifts with the head)
_IGNORED = ("jawLeft", "jawRight", "mouthLeft", "mouthRight", "jawForward")


def speaker_curves(weights: np.ndarray, names: list[str]) -> np.ndarray:
    """One speaker's [N, T, 52] weights -> [N, T, 53] with the neutral taken off and scaled.

    The neutral is the pose of the speaker's shut lips (a quantile of each channel by itself is a
    pose that nobody shows: it left one speaker's lips 5 mm inside each other). The gain brings the
    jaw to one size, within limits: how far a person opens cannot be heard.
    """
    curves = from_arkit(weights.reshape(-1, weights.shape[-1]).astype(np.float32), names)
    mouth = np.zeros_like(curves)
    columns = [c for c in SPEECH_COLUMNS if RIG_NAMES[c] not in _IGNORED]
    apart = opening(curves)
    shut = curves[apart <= np.nanquantile(apart, SHUT_SHARE)]
    mouth[:, columns] = np.clip(curves[:, columns] - np.median(shut[:, columns], axis=0), 0, 1)
    gain = JAW_LOUD / max(float(np.nanquantile(mouth[:, JAW_OPEN], 0.98)), 0.05)
    mouth *= np.clip(gain, 0.6, 2.0)
    return with_lips(mouth.reshape(*weights.shape[:2], len(RIG_NAMES)))


def with_lips(curves: np.ndarray) -> np.ndarray:
    """One speaker's [N, T, 53] -> the same with lips that move as far as people's.

    How far the lips are apart is kept: what lips open more, the jaw opens less.
    """
    result = curves.copy()
    for name, loud in LIPS_LOUD.items():
        columns = _columns(name)
        moved = curves[..., columns].mean(-1)
        gain = min(loud / max(float(np.nanquantile(moved, 0.98)), 1e-6), LIPS_MOST)
        result[..., columns] = np.clip(gain * _smooth(moved), 0, 1)[..., None]
    pucker = RIG_INDEX["mouthPucker"]
    gain = PUCKER_LOUD / max(float(np.nanquantile(curves[..., pucker], 0.98)), 1e-6)
    result[..., pucker] *= np.clip(gain, 1 / PUCKER_MOST, PUCKER_MOST)
    jaw, result[..., JAW_OPEN] = curves[..., JAW_OPEN], 0
    unit = closing_weight(np.eye(len(RIG_NAMES))[[JAW_OPEN]])
    wanted, by_lips = closing_weight(curves), closing_weight(result)
    room = wanted - JAW_LEAST * unit * jaw
    openers = [column for name in LIP_OPENERS for column in _columns(name)]
    result[..., openers] *= np.clip(room / np.maximum(by_lips, 1e-6), 0, 1)[..., None]
    result[..., JAW_OPEN] = (wanted - closing_weight(result)) / unit
    return result


def _columns(name: str) -> list[int]:
    return [RIG_INDEX[n] for n in (name, f"{name}_L", f"{name}_R") if n in RIG_INDEX]


def _smooth(curves: np.ndarray) -> np.ndarray:  # [N, T]
    """A quarter of both neighbours."""
    padded = np.pad(curves, ((0, 0), (1, 1)), "edge")
    return 0.25 * padded[:, :-2] + 0.5 * padded[:, 1:-1] + 0.25 * padded[:, 2:]


def at_ticks(curves: np.ndarray, fps: float, samples: int) -> np.ndarray:
    """[T, C] labels at `fps` -> [T', C] at the ends of the ticks of `samples` at 48 kHz."""
    times = frame_times(samples // SAMPLES_PER_FRAME)
    source = np.arange(len(curves)) / fps + LABEL_LATE_S
    return np.stack([np.interp(times, source, column) for column in curves.T], 1)


def spoken(rig: np.ndarray, span_s: tuple[float, float]) -> np.ndarray:
    """[T, 53] that fades to rest outside the words: the tracker's open lips there are breathing."""
    times = frame_times(len(rig))
    outside = np.maximum((span_s[0] - 0.12 - times) / 0.12, (times - span_s[1] - 0.12) / 0.15)
    inside = 0.5 + 0.5 * np.cos(np.pi * np.clip(outside, 0, 1))
    rig = (rig * inside[:, None]).astype(np.float32)
    rig[:, MOUTH_CLOSE] = np.minimum(rig[:, MOUTH_CLOSE], closing_weight(rig))
    return rig
