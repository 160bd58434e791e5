"""Rule-made face motion: phones and loudness -> [T, 53] rig curves at 30 FPS, and gaze.

Second stage of the capture. Dominance functions in the manner of Cohen and Massaro with JALI-like
rules: p b m close the lips, f v touch the teeth, vowels open the jaw by height and loudness. The
truth is made by rules: it proves learning and causality, not human realism.
"""

from dataclasses import dataclass

import numpy as np

from encoder.capture.channels import JAW_OPEN, MOUTH_CLOSE, RIG_INDEX, RIG_NAMES
from encoder.capture.speech import Phone
from encoder.gaze import GazeSynth
from sensors.types import FPS, SAMPLE_RATE, SAMPLES_PER_FRAME

# One row a phone: jaw, closure, touch (lower lip to teeth), funnel, pucker, stretch, lower lip
# down, upper lip up, shrug. All 0..1 of the full gesture, scaled below.
_GESTURES = ("jaw", "close", "touch", "funnel", "pucker", "stretch", "lower", "upper", "shrug")
_REST = dict.fromkeys(_GESTURES, 0.0)
_SHAPES: dict[str, dict[str, float]] = {
    **{p: {"close": 1.0, "jaw": 0.12} for p in ("p", "b", "m")},
    **{p: {"touch": 1.0, "jaw": 0.14, "upper": 0.25} for p in ("f", "v")},
    **{p: {"jaw": 0.1, "stretch": 0.4, "lower": 0.55, "upper": 0.15} for p in ("s", "z")},
    **{p: {"jaw": 0.12, "funnel": 0.8, "lower": 0.3, "upper": 0.3} for p in ("sh", "zh", "ch")},
    "jh": {"jaw": 0.12, "funnel": 0.75, "lower": 0.3, "upper": 0.3},
    **{p: {"jaw": 0.26, "lower": 0.45} for p in ("t", "d", "n")},
    **{p: {"jaw": 0.3, "lower": 0.5} for p in ("th", "dh", "l")},
    **{p: {"jaw": 0.36, "lower": 0.25} for p in ("k", "g", "ng", "hh")},
    "r": {"jaw": 0.28, "funnel": 0.55, "pucker": 0.2},
    "w": {"jaw": 0.16, "pucker": 0.95, "funnel": 0.2},
    "y": {"jaw": 0.24, "stretch": 0.4, "lower": 0.3},
    "aa": {"jaw": 1.0, "lower": 0.35, "upper": 0.2},
    "ae": {"jaw": 0.92, "stretch": 0.45, "lower": 0.5, "upper": 0.3},
    "ah": {"jaw": 0.74, "lower": 0.35, "upper": 0.1},
    "ao": {"jaw": 0.8, "funnel": 0.45, "pucker": 0.15},
    "aw": {"jaw": 0.85, "funnel": 0.35, "pucker": 0.25},
    "ax": {"jaw": 0.5, "lower": 0.25},
    "ay": {"jaw": 0.88, "stretch": 0.3, "lower": 0.4, "upper": 0.2},
    "eh": {"jaw": 0.7, "stretch": 0.4, "lower": 0.45, "upper": 0.15},
    "er": {"jaw": 0.45, "funnel": 0.5, "pucker": 0.15},
    "ey": {"jaw": 0.58, "stretch": 0.5, "lower": 0.45, "upper": 0.15},
    "ih": {"jaw": 0.46, "stretch": 0.4, "lower": 0.35},
    "iy": {"jaw": 0.34, "stretch": 0.75, "lower": 0.5, "upper": 0.15},
    "ow": {"jaw": 0.6, "funnel": 0.4, "pucker": 0.6},
    "oy": {"jaw": 0.68, "funnel": 0.45, "pucker": 0.45},
    "uh": {"jaw": 0.42, "funnel": 0.35, "pucker": 0.4},
    "uw": {"jaw": 0.28, "pucker": 0.9, "funnel": 0.25},
}
# How strongly a phone insists on a gesture, against 1 for one that does not shape it (every phone
# pulls to neutral, else tracks stick), and how far its reach is stretched: lip rounding spreads,
# closures are quick.
_INSIST = {"close": 2.0, "touch": 1.8, "funnel": 2.5, "pucker": 2.5}
_REACH = {"close": 0.6, "touch": 0.65, "funnel": 1.3, "pucker": 1.3}
# Full gestures in rig units: {channel: weight}. jaw and close are handled in `_compose`.
_GESTURE_RIG: dict[str, dict[str, float]] = {
    "funnel": {"mouthFunnel": 0.42},
    "pucker": {"mouthPucker": 0.55, "mouthFunnel": 0.08},
    "stretch": {
        "mouthStretch_L": 0.28,
        "mouthStretch_R": 0.28,
        "mouthDimple_L": 0.12,
        "mouthDimple_R": 0.12,
    },
    "lower": {"mouthLowerDown_L": 0.32, "mouthLowerDown_R": 0.32},
    "upper": {"mouthUpperUp_L": 0.24, "mouthUpperUp_R": 0.24},
    "touch": {"mouthRollLower": 0.55, "mouthUpperUp_L": 0.14, "mouthUpperUp_R": 0.14},
    "shrug": {"mouthShrugLower": 0.2},
}
# Millimetres that one unit of a channel opens (+) or closes (-) the inner lips of the rig's mean
# face; `mouthClose` closes what the others opened.
_OPENING_MM = {
    "jawOpen": 28.9,
    "mouthFunnel": 10.8,
    "mouthLowerDown_L": 2.9,
    "mouthLowerDown_R": 2.9,
    "mouthUpperUp_L": 3.5,
    "mouthUpperUp_R": 3.5,
}
_CLOSE_MM = 37.2


def closing_weight(curves: np.ndarray) -> np.ndarray:
    """[T, 53] -> [T] the `mouthClose` that just shuts lips which the other channels opened."""
    opening_mm = sum(mm * curves[:, RIG_INDEX[name]] for name, mm in _OPENING_MM.items())
    return np.asarray(opening_mm / _CLOSE_MM)


@dataclass(frozen=True)
class Style:
    """How one subject moves; without it a diffusion model would have nothing to learn."""

    jaw: float = 1.0
    lips: float = 1.0
    spread: float = 1.0
    lead_s: float = 0.05
    lag_s: float = 0.055
    smile: float = 0.0
    skew: float = 0.0

    @staticmethod
    def draw(rng: np.random.Generator) -> "Style":
        low = (0.8, 0.8, 0.6, 0.04, 0.045, -0.06, -0.08)
        high = (1.2, 1.2, 1.3, 0.06, 0.07, 0.1, 0.08)
        jaw, lips, spread, lead, lag, smile, skew = rng.uniform(low, high)
        return Style(jaw, lips, spread, lead, lag, max(0.0, smile), skew)


def frame_times(num_frames: int) -> np.ndarray:
    """[T] seconds. Frame k belongs to the END of its 1600 samples, as in the live path."""
    return (np.arange(num_frames) + 1) / FPS


def loudness(audio: np.ndarray) -> np.ndarray:
    """[n] at 48 kHz -> [T] 0..1: level of 50 ms around each frame time, 1 at the clip's loudest."""
    num_frames = len(audio) // SAMPLES_PER_FRAME
    power = np.concatenate([[0.0], np.cumsum(audio.astype(np.float64) ** 2)])
    centre = (frame_times(num_frames) * SAMPLE_RATE).astype(int)
    start, end = np.maximum(centre - 1200, 0), np.minimum(centre + 1200, len(audio))
    rms = np.sqrt((power[end] - power[start]) / np.maximum(end - start, 1))
    return np.clip(rms / max(float(np.quantile(rms, 0.97)), 1e-4), 0, 1).astype(np.float32)


def _tracks(phones: list[Phone], times: np.ndarray, style: Style) -> dict[str, np.ndarray]:
    """Blend the phones' targets by dominance a * exp(-(distance / reach)^1.5): gesture -> [T]."""
    start = np.array([p.start for p in phones])[:, None]
    end = np.array([p.end for p in phones])[:, None]
    # the target holds over the first half of a phone; from there the next one may take over
    hold_end = np.maximum(start + 0.01, end - 0.35 * (end - start).clip(max=0.12))
    early = np.maximum(start - times, 0) / style.lead_s
    late = np.maximum(times - hold_end, 0) / style.lag_s
    distance = (early + late) ** 1.5  # [P, T]
    tracks = {}
    for gesture in _GESTURES:
        target = np.array([_SHAPES.get(p.name, _REST).get(gesture, 0.0) for p in phones])
        insist = np.where(target > 0, _INSIST.get(gesture, 1.0), 1.0)
        weight = np.exp(-distance / _REACH.get(gesture, 1.0) ** 1.5) * insist[:, None]
        tracks[gesture] = (weight * target[:, None]).sum(0) / (weight.sum(0) + 0.02)
    return tracks


def _speaking(phones: list[Phone], times: np.ndarray) -> np.ndarray:
    """[T] 1 while a phone sounds, 0 when none is within 100 ms before or 160 ms after."""
    sounding = [p for p in phones if p.name != "pau"]
    if not sounding:
        return np.zeros(len(times))
    start = np.array([p.start for p in sounding])[:, None]
    end = np.array([p.end for p in sounding])[:, None]
    before, after = (start - times) / 0.1, (times - end) / 0.16
    outside = np.clip(np.maximum(before, after), 0, 1).min(0)
    return 0.5 + 0.5 * np.cos(np.pi * outside)


def _compose(tracks: dict[str, np.ndarray], level: np.ndarray, style: Style) -> np.ndarray:
    """Gesture tracks -> [T, 53] speech channels. Lips that close cancel what opened them."""
    curves = np.zeros((len(level), len(RIG_NAMES)), np.float32)
    close = np.clip(1.3 * tracks["close"], 0, 1)
    touch = np.clip(1.15 * tracks["touch"], 0, 1)
    closed = np.maximum(close, 0.85 * touch)
    jaw = 0.5 * style.jaw * tracks["jaw"] * (0.35 + 0.65 * level**0.7)
    curves[:, JAW_OPEN] = jaw * (1 - 0.55 * close) * (1 - 0.35 * touch)
    for gesture, channels in _GESTURE_RIG.items():
        size = style.spread if gesture == "stretch" else style.lips
        track = touch if gesture == "touch" else tracks[gesture] * (1 - 0.9 * closed)
        for channel, weight in channels.items():
            side = 1 + style.skew * (channel.endswith("_L") - channel.endswith("_R"))
            curves[:, RIG_INDEX[channel]] += size * weight * side * track
    curves[:, MOUTH_CLOSE] = closed * closing_weight(curves)
    for side in "LR":
        curves[:, RIG_INDEX[f"mouthPress_{side}"]] = 0.22 * style.lips * close
        curves[:, RIG_INDEX[f"mouthSmile_{side}"]] += style.smile
    return curves


def speech_curves(
    phones: list[Phone], audio: np.ndarray, style: Style, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """phones, audio [n] at 48 kHz -> rig curves [T, 53] and gaze [T, 2, 3]."""
    level = loudness(audio)
    times = frame_times(len(level))
    speaking = _speaking(phones, times)[:, None].astype(np.float32)
    curves = np.zeros((len(level), len(RIG_NAMES)), np.float32)
    if phones:
        curves = speaking * _compose(_tracks(phones, times, style), level, style)
    upper, gaze = upper_face(level * speaking[:, 0], rng)
    return np.clip(curves + upper, 0, 1), gaze


_BLINK = np.array([0.45, 1.0, 0.95, 0.72, 0.48, 0.28, 0.14, 0.06, 0.02], np.float32)
_BLINK_TURN = 11.0  # degrees: a gaze shift this large usually comes with a blink


def _blinks(angles: np.ndarray, per_minute: float, rng: np.random.Generator) -> np.ndarray:
    """[T, 2] gaze angles -> [T] 0..1: about 9 frames each, closing fast; some of them partial.

    Most blinks ride on a large gaze shift, so that gaze tells when; the rest wait log-normally.
    """
    num_frames = len(angles)
    curve = np.zeros(num_frames + 16, np.float32)
    speed = np.zeros(num_frames)
    speed[1:] = np.abs(np.diff(angles, axis=0)).max(1)
    moving = np.flatnonzero((speed[1:] > 0.02) & (speed[:-1] <= 0.02)) + 1
    turns = [i for i in moving if np.abs(angles[min(i + 5, num_frames - 1)] - angles[i - 1]).max()
             > _BLINK_TURN and rng.random() < 0.92]  # fmt: skip
    starts = [(int(i) + 1, 1.0) for i in turns]
    position = rng.exponential(60 / per_minute) * FPS
    while position < num_frames:
        starts.append((int(position), rng.uniform(0.5, 0.9)))
        position += 9 + rng.lognormal(np.log(45 / per_minute), 0.6) * FPS
    for start, depth in starts:
        curve[start : start + 9] = np.maximum(curve[start : start + 9], depth * _BLINK)
    return curve[:num_frames]


def _look(num_frames: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """The live path's own gaze: [T, 2, 3] unit vectors and [T, 2] yaw and pitch in degrees."""
    synth = GazeSynth(int(rng.integers(1 << 31)))
    state, rows = synth.init_state(), []
    for _ in range(num_frames):
        gaze, state = synth.step(state)
        rows.append(gaze)
    gaze = np.stack(rows) if rows else np.zeros((0, 2, 3), np.float32)
    x, y, z = gaze.mean(1).T
    return gaze, np.degrees(np.stack([np.arctan2(x, z), np.arcsin(y)], 1))


def upper_face(level: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Loudness [T] 0..1 (0 when silent) -> blinks, lids, eyes, brows [T, 53] and gaze [T, 2, 3]."""
    num_frames = len(level)
    curves = np.zeros((num_frames, len(RIG_NAMES)), np.float32)
    talking = float((level > 0.1).mean()) if num_frames else 0.0
    gaze, angles = _look(num_frames, rng)
    blink = _blinks(angles, 3 + 4 * talking, rng)
    yaw, pitch = angles.T / 30
    for side, outward in (("L", yaw), ("R", -yaw)):
        lid = np.clip(blink + 0.25 * np.clip(-pitch, 0, 1), 0, 1)
        for name, curve in (
            ("eyeBlink", lid),
            ("eyeLookOut", outward),
            ("eyeLookIn", -outward),
            ("eyeLookUp", pitch),
            ("eyeLookDown", -pitch),
            ("eyeWide", 0.3 * pitch),
        ):
            curves[:, RIG_INDEX[f"{name}_{side}"]] = np.clip(curve, 0, 1)
    # brows rise with accents: the loud peaks of slow loudness, some of them
    kernel = np.hanning(15)[1:-1]
    slow = np.convolve(level, kernel / kernel.sum(), mode="same")[:num_frames]
    accent = np.zeros(num_frames)
    peaks = np.flatnonzero((slow[1:-1] > slow[:-2]) & (slow[1:-1] >= slow[2:]) & (slow[1:-1] > 0.4))
    for peak in peaks:
        if rng.random() < 0.3:
            distance = (np.arange(num_frames) - peak - 1) / 6
            accent += rng.uniform(0.15, 0.5) * np.exp(-(distance**2))
    for side in "LR":
        curves[:, RIG_INDEX[f"browInnerUp_{side}"]] = np.clip(0.8 * accent, 0, 0.7)
        curves[:, RIG_INDEX[f"browOuterUp_{side}"]] = np.clip(0.6 * accent, 0, 0.6)
    return curves, gaze
