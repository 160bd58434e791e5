"""Real near-eye videos through the Driver: blinks, gaze against the pupil, jitter.

For evaluation only: nothing trains on them. The truth is independent of every network: blinks and
visible eyes come from lists of frames (labels.py), the pupil from an ellipse fit (pupil.py).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from app.eval.eyes.labels import Label, inside
from sensors.types import EYE_SIZE, FPS, NS, SAMPLES_PER_FRAME, SensorFrame

if TYPE_CHECKING:
    from encoder.driver import Driver

Floats = NDArray[np.floating]
Metrics = dict[str, float]
NEAR_FRAMES = 2  # the lid moves for this long before and after a blink
MOVES = 0.08  # of the picture's width, 5th to 95th percentile: the pupil counts as moving
STILL, STILL_FRAMES = 0.004, 10  # of the width, within so many frames: the pupil is still
STILL_PICTURE = 2.5  # mean difference between frames in grey levels: the picture is still


@dataclass(frozen=True, eq=False)
class RealClip:
    """One clip: camera pictures, and what the Driver made of them."""

    label: Label
    eyes: tuple[int, ...]  # those with a camera
    views: NDArray[np.uint8]  # [T, 2, 400, 400]
    opening: Floats  # [T] of the avatar's lids: 1 open
    gaze: Floats  # [T, 2, 3] as shown
    lids: Floats  # [T, 2] as the tracker has them
    accepted: NDArray[np.bool_]  # [T, 2] the gaze shown is from this eye's own picture
    score: Floats  # [T, 2] probability that the picture shows an eye
    pupils: Floats  # [T, 2, 4] x, y (up), radius in widths of the view; 1 where the fit is good


def show(label: Label, driver: "Driver", blink: Callable[[Floats], Floats], seed: int) -> RealClip:
    """Drive a clip in silence; `blink`: codes [T, 256] -> how shut the avatar's lids are [T]."""
    from app.eval.eyes.pupil import find_pupil
    from encoder.eyes.tracker import OWN, EyeState

    videos = [read_views(path) if path else None for path in label.videos]
    eyes = tuple(e for e in (0, 1) if videos[e] is not None)
    count = min(len(video) for video in videos if video is not None)
    views = np.zeros((count, 2, EYE_SIZE, EYE_SIZE), np.uint8)
    pupils = np.zeros((count, 2, 4))
    for eye in eyes:
        video = videos[eye]
        assert video is not None
        views[:, eye] = video[:count]
        for t in range(count):
            x, y, radius, good = find_pupil(views[t, eye])
            pupils[t, eye] = x / EYE_SIZE, -y / EYE_SIZE, radius / EYE_SIZE, good
    state, codes = driver.init_state(seed), list[Floats]()
    rows: list[tuple[NDArray[Any], ...]] = []
    for frame in silent_frames(views, eyes):
        driven, state = driver.step(frame, state)
        assert isinstance(state.gaze, EyeState) and state.gaze.shown is not None
        own = [
            s == OWN and lost == 0
            for s, lost in zip(state.gaze.source, state.gaze.lost, strict=True)
        ]
        lids, score = state.gaze.shown.lids, np.array(state.gaze.score)
        rows.append((driven.gaze, lids, np.array(own), score))
        codes.append(driven.expression)
    gaze, lids, accepted, score = (np.stack(column) for column in zip(*rows, strict=True))
    opening = 1 - blink(np.stack(codes))
    return RealClip(label, eyes, views, opening, gaze, lids, accepted, score, pupils)


def read_views(path: Path) -> NDArray[np.uint8]:  # [T, 400, 400]
    """All pictures of a video as an eye camera delivers them, in order."""
    from sensors.cameras.views import fit
    from sensors.picture import gray
    from sensors.session.eye_video import open_video

    with open_video(path) as container:
        return np.stack([fit(gray(f)) for f in container.decode(container.streams.video[0])])


def silent_frames(views: NDArray[np.uint8], eyes: tuple[int, ...]) -> list[SensorFrame]:
    """Sensor frames without sound: one picture a tick, whatever the video's frame rate."""
    valid = np.isin((0, 1), eyes)
    return [
        SensorFrame(
            index=t,
            t_ns=(t + 1) * NS // FPS,
            audio=np.zeros(SAMPLES_PER_FRAME, np.float32),
            eyes=pair,
            eyes_valid=valid,
            eyes_age_ns=np.where(valid, 0, -1),
            audio_gap=False,
        )
        for t, pair in enumerate(views)
    ]


def clip_metrics(clip: RealClip) -> Metrics:
    """Metrics of one clip; those that it has no data for are left out."""
    from encoder.evaluation.eye_metrics import compare_blinks, shut_frames
    from encoder.evaluation.metrics import runs

    count, label = len(clip.opening), clip.label
    lowered = inside(label.blinks + label.partial, count, NEAR_FRAMES)
    visible = ~inside(label.no_eye, count) & ~lowered
    shut = shut_frames(clip.opening)
    for start, stop in runs(shut):  # partial blinks count neither way
        either = inside(label.partial, count, NEAR_FRAMES)[start:stop].any()
        if either and not inside(label.blinks, count)[start:stop].any():
            shut[start:stop] = False
    blinks = compare_blinks(shut, inside(label.blinks, count))
    own = np.stack([clip.accepted[:, eye] for eye in clip.eyes], 1)
    result = {
        "seconds": count / FPS,
        "accepted_share": float(own[visible].mean()),
        "blinks": float(blinks.hits + blinks.missed),
        "blinks_missed": float(blinks.missed),
        "blinks_false": float(blinks.false),
    }
    if blinks.latencies:
        result["onset_delay_frames_worst"] = float(max(map(abs, blinks.latencies)))
    return result | _gaze_metrics(clip, visible)


def _gaze_metrics(clip: RealClip, visible: NDArray[np.bool_]) -> Metrics:
    """Correlation of gaze and pupil (the worse eye, for each axis on which the pupil moves), and
    jitter while it is still."""
    r: dict[str, list[float]] = {"gaze_r_x": [], "gaze_r_y": []}
    jitter: list[float] = []
    for eye in clip.eyes:
        pupil, gaze = clip.pupils[:, eye], clip.gaze[:, eye]
        good = visible & (pupil[:, 3] > 0)
        if good.sum() < 3 * STILL_FRAMES:
            continue
        for axis, name in enumerate(r):
            low, high = np.percentile(pupil[good, axis], (5, 95))
            if high - low > MOVES:
                r[name].append(float(np.corrcoef(gaze[good, axis], pupil[good, axis])[0, 1]))
        jitter += _jitter_deg(clip.views[:, eye, ::4, ::4], pupil, good, gaze)
    result = {name: min(values) for name, values in r.items() if values}
    return result | ({"jitter_deg": float(np.median(jitter))} if jitter else {})


def _jitter_deg(
    small: NDArray[np.uint8], pupil: Floats, good: NDArray[np.bool_], gaze: Floats
) -> list[float]:
    """RMS deviation of the gaze from its mean, for each stretch in which the eye is still."""
    result: list[float] = []
    for start in range(0, len(good) - STILL_FRAMES + 1, STILL_FRAMES // 2):
        cut = slice(start, start + STILL_FRAMES)
        if not good[cut].all() or np.ptp(pupil[cut, :2], 0).max() > 2 * STILL:
            continue
        if np.abs(np.diff(small[cut].astype(np.int16), axis=0)).mean() > STILL_PICTURE:
            continue
        away = gaze[cut] - gaze[cut].mean(0)
        result.append(float(np.degrees(np.sqrt((away**2).sum(-1).mean()))))
    return result


def real_metrics(clips: Sequence[RealClip]) -> Metrics:
    """Metrics of each clip under its name, and the worst or the sum over all clips."""
    rows = {clip.label.name: clip_metrics(clip) for clip in clips}
    minutes = sum(row["seconds"] for row in rows.values()) / 60
    result = {
        "real_accepted_share_worst": min(row["accepted_share"] for row in rows.values()),
        "real_blinks": sum(row["blinks"] for row in rows.values()),
        "real_blinks_missed": sum(row["blinks_missed"] for row in rows.values()),
        "real_blinks_false_per_minute": sum(r["blinks_false"] for r in rows.values()) / minutes,
    }
    for name, worst in (
        ("onset_delay_frames_worst", max), ("gaze_r_x", min), ("gaze_r_y", min), ("jitter_deg", max)
    ):  # fmt: skip
        values = [row[name] for row in rows.values() if name in row]
        if values:
            result[f"real_{name.removesuffix('_worst')}_worst"] = worst(values)
    each = {f"real_{n}_{k}": v for n, row in rows.items() for k, v in row.items()}
    return result | each
