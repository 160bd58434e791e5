"""Rule-made eyes, lids and brows: fixations and saccades, blinks, brows at accents.

Part of the motion rules. Published averages: blinks 26 a minute talking, 17 at rest, 4.5 reading,
half of them partial; saccades last 25 ms + 2.4 ms a degree; speakers look at their partner 41 % of
the time, listeners 75 %; lids follow the gaze down.
"""

import numpy as np

from encoder.capture.motion.channels import RIG_INDEX, RIG_NAMES
from sensors.types import FPS

BLINKS_TALKING, BLINKS_RESTING, BLINKS_READING = 26.0, 17.0, 5.0  # a minute
SACCADE_S, SACCADE_S_PER_DEG = 0.025, 0.0024
PARTNER_TALKING, PARTNER_LISTENING = 0.41, 0.75
EYE_X_MM = 31.95  # half the distance between the eyes
REFRACTORY = 11  # frames from one blink's start to the next's


def upper_face(
    level: np.ndarray,
    rng: np.random.Generator,
    *,
    reading: bool = False,
    brows: float = 1.0,
    blinks: float = 1.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Loudness [T] 0..1 (0 when silent) -> blinks, lids, eyes, brows [T, 53] and gaze [T, 2, 3]."""
    num_frames = len(level)
    curves = np.zeros((num_frames, len(RIG_NAMES)), np.float32)
    if num_frames == 0:
        return curves, np.zeros((0, 2, 3), np.float32)
    talking = _talking(level)
    fixations = _read(num_frames, rng) if reading else _look(talking, rng)
    angles, shifts = _saccades(fixations, num_frames)
    if reading:
        rate = np.full(num_frames, BLINKS_READING)
    else:
        rate = BLINKS_RESTING + (BLINKS_TALKING - BLINKS_RESTING) * talking
    # the small steps along a line seldom blink, its end sometimes does
    lid = _blinks(0.6 * shifts if reading else shifts, blinks * rate, rng)
    _turn_eyes(curves, angles, lid)
    accent = brows * _accents(level, rng)
    for side in "LR":
        curves[:, RIG_INDEX[f"browInnerUp_{side}"]] = np.clip(0.8 * accent, 0, 0.7)
        curves[:, RIG_INDEX[f"browOuterUp_{side}"]] = np.clip(0.6 * accent, 0, 0.6)
        down = curves[:, RIG_INDEX[f"browDown_{side}"]]
        down += np.clip(0.2 * lid, 0, 0.2)  # orbicularis pulls the brow a little
    return curves, directions(angles, fixations, num_frames)


def looking(yaw_deg: float, pitch_deg: float) -> np.ndarray:
    """Eyes at rest that look there: rig [53]."""
    curves = np.zeros((1, len(RIG_NAMES)), np.float32)
    _turn_eyes(curves, np.array([[yaw_deg, pitch_deg]]), np.zeros(1))
    return curves[0]


def _turn_eyes(curves: np.ndarray, angles: np.ndarray, lid: np.ndarray) -> None:
    """Into curves: eyes that look at angles [T, 2] degrees, and their lids, shut by lid [T]."""
    yaw, pitch = angles[:, 0] / 30, angles[:, 1] / 30
    for side, outward in (("L", yaw), ("R", -yaw)):
        lids = np.clip(lid + 0.25 * np.clip(-pitch, 0, 1), 0, 1)
        for name, curve in (
            ("eyeBlink", lids),
            ("eyeLookOut", outward),
            ("eyeLookIn", -outward),
            ("eyeLookUp", pitch),
            ("eyeLookDown", -pitch),
            ("eyeWide", 0.3 * pitch),
            ("eyeSquint", 0.25 * lid),
        ):
            curves[:, RIG_INDEX[f"{name}_{side}"]] = np.clip(curve, 0, 1)


def _talking(level: np.ndarray) -> np.ndarray:
    """[T] 0..1: is there speech within a second?"""
    loud = np.convolve(level > 0.1, np.ones(2 * FPS + 1), mode="full")
    return np.clip(loud[FPS : FPS + len(level)] / 10, 0, 1)


def _look(talking: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Fixations [F, 4]: first frame, yaw and pitch in degrees, distance in mm."""
    rows, frame = [(0.0, 0.0, 0.0, 1000.0)], int(rng.uniform(0.1, 1) * FPS)
    while frame < len(talking):
        share = PARTNER_LISTENING + (PARTNER_TALKING - PARTNER_LISTENING) * talking[frame]
        if rng.random() < share:
            yaw, pitch, distance = rng.normal(0, 1.5), rng.normal(0, 1.0), 1000.0
            dwell_s = rng.lognormal(np.log(0.65), 0.6)
        else:
            yaw, pitch = rng.normal(0, 11.0), rng.normal(-2.5, 6.0)
            distance, dwell_s = rng.uniform(600, 3000), rng.lognormal(np.log(0.6), 0.6)
        rows.append((frame, np.clip(yaw, -28, 28), np.clip(pitch, -20, 15), distance))
        frame += max(4, round(dwell_s * FPS))
    return np.array(rows, np.float64)


def _read(num_frames: int, rng: np.random.Generator) -> np.ndarray:
    """Reading aloud: steps of about 2.5 degrees to the right, and back at the end of a line."""
    distance, width = rng.uniform(500, 900), rng.uniform(7, 11)
    rows, frame, yaw, pitch = [], 0, -width, rng.uniform(-4, 2)
    while frame < num_frames:
        rows.append((frame, -yaw + rng.normal(0, 0.2), pitch + rng.normal(0, 0.15), distance))
        frame += max(4, round(rng.lognormal(np.log(0.24), 0.3) * FPS))
        yaw += rng.normal(2.5, 0.8)
        if yaw > width:
            yaw, pitch = -width, pitch - rng.uniform(0.6, 1.2)
            if pitch < -14:
                pitch = rng.uniform(-4, 2)
    return np.array(rows, np.float64)


def _saccades(fixations: np.ndarray, num_frames: int) -> tuple[np.ndarray, np.ndarray]:
    """-> angles [T, 2] degrees, and [T] the size of the shift that begins at a frame, else 0."""
    begin = fixations[:, 0].astype(int)
    frames = np.arange(num_frames)
    which = np.searchsorted(begin, frames, side="right") - 1
    goal = fixations[:, 1:3]
    origin = np.concatenate([goal[:1], goal[:-1]])
    size = np.hypot(*(goal - origin).T)
    length = np.maximum((SACCADE_S + SACCADE_S_PER_DEG * size) * FPS, 1.0)
    progress = np.clip((frames - begin[which] + 1) / length[which], 0, 1)
    eased = progress**3 * (10 - 15 * progress + 6 * progress**2)  # minimum jerk
    angles = origin[which] + eased[:, None] * (goal - origin)[which]
    shifts = np.zeros(num_frames)
    shifts[begin[begin < num_frames]] = size[begin < num_frames]
    return angles, shifts


def directions(angles: np.ndarray, fixations: np.ndarray, num_frames: int) -> np.ndarray:
    """Both eyes look at one point -> [T, 2, 3] unit vectors, left eye first."""
    which = np.searchsorted(fixations[:, 0], np.arange(num_frames), side="right") - 1
    yaw, pitch = np.radians(angles).T
    forward = np.stack([np.sin(yaw) * np.cos(pitch), np.sin(pitch), np.cos(yaw) * np.cos(pitch)], 1)
    distance = fixations[which, 3]
    distance = np.convolve(np.pad(distance, 3, mode="edge"), np.ones(7) / 7, "valid")
    eyes = np.array([[EYE_X_MM, 0.0, 0.0], [-EYE_X_MM, 0.0, 0.0]])
    rays = distance[:, None, None] * forward[:, None] - eyes
    return (rays / np.linalg.norm(rays, axis=-1, keepdims=True)).astype(np.float32)


def _blinks(shifts: np.ndarray, rate: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """[T] lid 0..1. Shifts beyond 33 degrees blink, small ones seldom; the rest wait log-normally.

    `rate` [T] is how many a minute there should be in all.
    """
    num_frames = len(shifts)
    chance = np.clip((shifts - 8) / 25, 0, 1)
    starts = {int(f): True for f in np.flatnonzero(rng.random(num_frames) < chance)}
    gaze_rate = chance.sum() / num_frames * 60 * FPS
    frame = rng.exponential(60 / max(rate.mean(), 1)) * FPS
    while frame < num_frames:
        starts.setdefault(int(frame), False)
        left = max(float(rate[int(frame)]) - gaze_rate, 0.15 * float(rate[int(frame)]))
        # REFRACTORY drops a few blinks that fall together
        frame += rng.lognormal(np.log(60 / (1.12 * left)) - 0.245, 0.7) * FPS
    lid, last = np.zeros(num_frames + 40), -REFRACTORY
    for start in sorted(starts):
        if start - last < REFRACTORY:
            continue
        last = start
        full = starts[start] or rng.random() < 0.5
        shape = _blink(1.0 if full else rng.uniform(0.45, 0.85), rng)
        cut = slice(start, start + len(shape))
        lid[cut] = np.maximum(lid[cut], shape[: len(lid[cut])])
    return lid[:num_frames]


def _blink(depth: float, rng: np.random.Generator) -> np.ndarray:
    """One blink: closes in 60-110 ms, rests a moment, opens about twice as slowly."""
    close, open_ = rng.uniform(1.9, 3.3), rng.lognormal(np.log(5.5), 0.2)
    hold, phase = rng.exponential(0.6), rng.uniform(0, 1)
    t = np.arange(1, int(close + hold + open_) + 3) - phase
    closing = np.clip(t / close, 0, 1)
    opening = np.clip((t - close - hold) / open_, 0, 1)
    return depth * (np.sin(0.5 * np.pi * closing) ** 2) * np.cos(0.5 * np.pi * opening) ** 2


def _accents(level: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """[T] brow raises: some of the loud peaks of slow loudness."""
    num_frames = len(level)
    kernel = np.hanning(15)[1:-1]
    slow = np.convolve(level, kernel / kernel.sum(), mode="same")[:num_frames]
    peaks = np.flatnonzero((slow[1:-1] > slow[:-2]) & (slow[1:-1] >= slow[2:]) & (slow[1:-1] > 0.4))
    accent = np.zeros(num_frames)
    for peak in peaks[rng.random(len(peaks)) < 0.3]:
        size, width = rng.uniform(0.15, 0.5), rng.uniform(4, 9)
        near = slice(max(peak - 30, 0), peak + 32)
        distance = (np.arange(num_frames)[near] - peak - 1) / width
        accent[near] += size * np.exp(-(distance**2))
    return accent
