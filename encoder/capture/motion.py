"""Rule-made face motion: phones and loudness -> rig curves at 30 FPS, tongue and gaze.

Second stage of the capture. Dominance functions in the manner of Cohen and Massaro with JALI-like
rules; contacts are then solved on mesh vertices. Timing is calibrated against tracked motion
(encoder/capture/calibrate.py). The truth is made by rules: it proves learning and causality, not
human realism.
"""

from typing import NamedTuple

import numpy as np

from encoder.capture import emotion as emotions
from encoder.capture.channels import JAW_OPEN, MOUTH_CLOSE, RIG_INDEX, RIG_NAMES, SPEECH_COLUMNS
from encoder.capture.contacts import SHUT_MM, SLOPE_MM, LipGeometry
from encoder.capture.gestures import (
    GESTURE_RIG,
    GESTURES,
    INSIST,
    REACH,
    REST,
    SHAPES,
    TONGUE_GESTURES,
    TOUCH_POSE,
)
from encoder.capture.phones import LIP_CLOSING, PHONES, TEETH_TOUCHING, Phone
from encoder.capture.style import Style
from encoder.capture.upper_face import upper_face
from sensors.types import FPS, SAMPLE_RATE, SAMPLES_PER_FRAME

__all__ = ["Motion", "closing_weight", "frame_times", "speech_curves", "upper_face"]

# Millimetres that one unit of a channel opens the inner lips of the rig's mean face.
_OPENING_MM = {
    "jawOpen": 28.9,
    "mouthFunnel": 10.8,
    "mouthLowerDown_L": 2.9,
    "mouthLowerDown_R": 2.9,
    "mouthUpperUp_L": 3.5,
    "mouthUpperUp_R": 3.5,
}
JAW_UNIT = 0.43  # jawOpen of an open vowel, spoken loudly
JAW_LATE_S = 0.03  # tracked jaws lag their sound's energy by about a frame
JAW_LOUD = 0.35  # and hardly follow its louder half: nearer to decibels than to amplitude
RAMP_S = 0.075  # lips close and part within this, 100-350 mm/s
JAW_STEP = 0.27  # most change of jawOpen a frame: 234 mm/s
GAP_STEP_MM = 11.5  # most change of the lips' gap a frame: 345 mm/s
_TOUCH = np.zeros(len(RIG_NAMES), np.float32)
for _name, _weight in TOUCH_POSE.items():
    _TOUCH[RIG_INDEX[_name]] = _weight


def closing_weight(curves: np.ndarray) -> np.ndarray:
    """[T, 53] -> [T] the `mouthClose` that just shuts lips which the other channels opened."""
    opening_mm = sum(mm * curves[:, RIG_INDEX[name]] for name, mm in _OPENING_MM.items())
    return np.asarray(opening_mm / SLOPE_MM)


class Motion(NamedTuple):
    """A clip's motion; frame k belongs to the end of its 1600 samples."""

    rig: np.ndarray  # [T, 53] float32 0..1
    gaze: np.ndarray  # [T, 2, 3] float32 unit vectors, left eye first
    tongue: np.ndarray  # [T, 3] float32 0..1: tongueOut, tongueTipUp, tongueBackUp


def frame_times(num_frames: int) -> np.ndarray:
    """[T] seconds. Frame k belongs to the END of its 1600 samples, as in the live path."""
    return (np.arange(num_frames) + 1) / FPS


def loudness(audio: np.ndarray, late_s: float = 0.0) -> np.ndarray:
    """[n] at 48 kHz -> [T] 0..1: level of 60 ms around each frame time, 1 at the clip's loudest."""
    num_frames = len(audio) // SAMPLES_PER_FRAME
    power = np.concatenate([[0.0], np.cumsum(audio.astype(np.float64) ** 2)])
    centre = ((frame_times(num_frames) - late_s) * SAMPLE_RATE).astype(int)
    start, end = np.clip(centre - 1440, 0, len(audio)), np.clip(centre + 1440, 0, len(audio))
    rms = np.sqrt((power[end] - power[start]) / np.maximum(end - start, 1))
    return np.clip(rms / max(float(np.quantile(rms, 0.97)), 1e-4), 0, 1).astype(np.float32)


def _tracks(phones: list[Phone], times: np.ndarray, style: Style) -> dict[str, np.ndarray]:
    """Blend the phones' targets by dominance a * exp(-(distance / reach)^1.5): gesture -> [T]."""
    start = np.array([p.start for p in phones])[:, None]
    end = np.array([p.end for p in phones])[:, None]
    # the target holds over the first half of a phone; from there the next one may take over
    hold_end = np.maximum(start + 0.01, end - 0.35 * (end - start).clip(max=0.12))
    index = np.array([PHONES.index(p.name) for p in phones])
    tracks = {}
    for column, gesture in enumerate(GESTURES):
        late_s = JAW_LATE_S if gesture == "jaw" else 0.0
        early = np.maximum(start + late_s - times, 0) / style.lead_s
        late = np.maximum(times - hold_end - late_s, 0) / style.lag_s
        target = np.array([SHAPES.get(p.name, REST).get(gesture, 0.0) for p in phones])
        insist = np.where(target > 0, INSIST.get(gesture, 1.0), 1.0)
        target = np.clip(target * style.idiolect[index, column], 0, 1.15)
        reach = REACH.get(gesture, 1.0)
        weight = np.exp(-(((early + late) / reach) ** 1.5)) * insist[:, None]
        tracks[gesture] = (weight * target[:, None]).sum(0) / (weight.sum(0) + 0.02)
    return tracks


def _holds(
    phones: list[Phone], names: tuple[str, ...], times: np.ndarray, taken: np.ndarray
) -> np.ndarray:
    """[H, 2] begin and end of the contact that each of `names` holds, in seconds.

    A plosive lets go at its burst, a nasal or fricative near its end. Where no frame falls into
    the hold, the nearest one that is not `taken` [T] by another contact is taken in.
    """
    free = np.where(taken, 1e3, 0.0)
    holds = []
    for phone in phones:
        if phone.name in names:
            share = 0.55 if phone.name in ("p", "b") else 0.8
            begin, end = phone.start - 0.012, phone.start + share * (phone.end - phone.start)
            nearest = times[np.argmin(np.abs(times - 0.5 * (begin + end)) + free)]
            holds.append((min(begin, nearest), max(end, nearest)))
    return np.array(holds).reshape(-1, 2)


def _contact(holds: np.ndarray, every: np.ndarray, times: np.ndarray) -> np.ndarray:
    """[T] 0..1: 1 in `holds` [H, 2], raised cosines around them.

    Between two of `every` contact they are shorter, so that even a short vowel opens the mouth.
    """
    contact = np.zeros(len(times))
    for begin, end in holds:
        before = np.min(begin - every[:, 1], initial=1.0, where=every[:, 1] < begin)
        after = np.min(every[:, 0] - end, initial=1.0, where=every[:, 0] > end)
        close_s, open_s = np.clip((0.6 * before, 0.6 * after), RAMP_S / 2, RAMP_S)
        outside = np.maximum((begin - times) / close_s, (times - end) / open_s)
        contact = np.maximum(contact, 0.5 + 0.5 * np.cos(np.pi * np.clip(outside, 0, 1)))
    return contact


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


def _open_mouth(
    tracks: dict[str, np.ndarray], level: np.ndarray, speaking: np.ndarray, style: Style
) -> np.ndarray:
    """Gesture tracks -> [T, 53] speech channels of a mouth without contacts."""
    curves = np.zeros((len(level), len(RIG_NAMES)), np.float32)
    loud = 1 - style.loud + style.loud * level**JAW_LOUD
    jaw = JAW_UNIT * style.jaw * tracks["jaw"] * loud
    curves[:, JAW_OPEN] = jaw * speaking
    for gesture, channels in GESTURE_RIG.items():
        size = style.spread if gesture == "stretch" else style.lips
        for channel, weight in channels.items():
            side = 1 + style.skew * (channel.endswith("_L") - channel.endswith("_R"))
            curves[:, RIG_INDEX[channel]] += size * weight * side * tracks[gesture] * speaking
    drift = "jawLeft" if style.sideways > 0 else "jawRight"
    curves[:, RIG_INDEX[drift]] = abs(style.sideways) * curves[:, JAW_OPEN]
    for side in "LR":
        curves[:, RIG_INDEX[f"mouthSmile_{side}"]] += style.smile * (0.6 + 0.4 * level) * speaking
    return curves


def _slew(curve: np.ndarray, step: float) -> np.ndarray:
    """[T] limited to `step` a frame, in both directions of time, by lowering only."""
    out = curve.astype(np.float32).tolist()
    for k in range(1, len(out)):
        out[k] = min(out[k], out[k - 1] + step)
    for k in range(len(out) - 2, -1, -1):
        out[k] = min(out[k], out[k + 1] + step)
    return np.array(out, np.float32)


def _with_contacts(
    curves: np.ndarray,  # [T, 53] open mouth, with any emotion
    close: np.ndarray,  # [T] 0..1
    touch: np.ndarray,  # [T] 0..1
    style: Style,
    lips: LipGeometry | None,
) -> np.ndarray:
    """Blend to the touch pose, raise the jaw a little, and let mouthClose shut the lips."""
    held = (touch >= 1) & (close < 1)
    close = np.where(held, 0, close)
    touch = np.where(held, 1, np.minimum(touch, 1 - close))[:, None].astype(np.float32)
    columns = list(SPEECH_COLUMNS)
    curves[:, columns] += touch * (_TOUCH[columns] - curves[:, columns])
    free = curves.copy()
    curves[:, JAW_OPEN] *= 1 - 0.2 * close
    for channel in (
        "mouthFunnel",
        *(f"mouth{n}_{s}" for n in ("LowerDown", "UpperUp") for s in "LR"),
    ):
        curves[:, RIG_INDEX[channel]] *= 1 - 0.9 * close
    for side in "LR":
        curves[:, RIG_INDEX[f"mouthPress_{side}"]] += style.press * style.lips * close
    curves[:, JAW_OPEN] = _slew(curves[:, JAW_OPEN], JAW_STEP)
    if lips is None:
        curves[:, MOUTH_CLOSE] = close * closing_weight(curves)
        return curves
    weight = close.astype(np.float32)
    gap = lips.gap_mm(curves)
    wanted = np.minimum(gap, (1 - weight) * lips.gap_mm(free) + weight * SHUT_MM)
    wanted = _slew(wanted, GAP_STEP_MM)
    busy = wanted < gap - 1e-3
    if busy.any():
        curves[busy, MOUTH_CLOSE] = lips.closed(curves[busy], wanted[busy])
    return curves


def speech_curves(
    phones: list[Phone],
    audio: np.ndarray,  # [n] at 48 kHz
    style: Style,
    rng: np.random.Generator,
    *,
    lips: LipGeometry | None = None,
    reading: bool = False,
    emotion: str = "neutral",
    strength: float = 1.0,
) -> Motion:
    """What a face does that says `phones` with this sound."""
    level, shifted = loudness(audio), loudness(audio, JAW_LATE_S)
    times = frame_times(len(level))
    speaking = _speaking(phones, times)
    curves = np.zeros((len(level), len(RIG_NAMES)), np.float32)
    tongue = np.zeros((len(level), len(TONGUE_GESTURES)), np.float32)
    upper, gaze = upper_face(
        level * speaking, rng, reading=reading, brows=style.brows, blinks=style.blinks
    )
    layer, gain = emotions.layer(emotion, strength, level * speaking, rng)
    close = touch = np.zeros(len(times))
    if phones:
        moved = _jittered(phones, style.jitter_s, rng)
        tracks = _tracks(moved, times, style)
        curves = gain * _open_mouth(tracks, shifted, speaking, style)
        lips_meet = _holds(phones, LIP_CLOSING, times, np.zeros(len(times), bool))
        shut = (times >= lips_meet[:, :1]) & (times <= lips_meet[:, 1:])
        lip_on_teeth = _holds(phones, TEETH_TOUCHING, times, np.asarray(shut.any(0)))
        every = np.concatenate([lips_meet, lip_on_teeth])
        close = _contact(lips_meet, every, times)
        touch = _contact(lip_on_teeth, every, times)
        for column, gesture in enumerate(TONGUE_GESTURES):
            tongue[:, column] = np.clip(tracks[gesture] * speaking, 0, 1)
    curves = np.clip(curves + upper + layer, 0, 1)
    return Motion(np.clip(_with_contacts(curves, close, touch, style, lips), 0, 1), gaze, tongue)


def _jittered(phones: list[Phone], spread_s: float, rng: np.random.Generator) -> list[Phone]:
    """Bounds moved by up to a few milliseconds, in order."""
    shift = rng.normal(0, spread_s, len(phones) + 1)
    return [
        Phone(p.name, p.start + shift[k], max(p.end + shift[k + 1], p.start + shift[k] + 0.01))
        for k, p in enumerate(phones)
    ]
