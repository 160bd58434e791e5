"""Rule-made face motion: phones and loudness -> rig curves at 30 FPS, tongue and gaze.

Second stage of the capture. Dominance functions in the manner of Cohen and Massaro with JALI-like
rules; contacts (closures.py) are then solved on mesh vertices. Timing is calibrated against
tracked motion (judging/lookahead.py). The truth is made by rules: it proves learning and
causality, not human realism.
"""

from typing import NamedTuple

import numpy as np

from encoder.capture.motion.channels import (
    JAW_OPEN,
    RIG_INDEX,
    RIG_NAMES,
)
from encoder.capture.motion.closures import contact, holds, with_contacts
from encoder.capture.motion.contacts import LipGeometry
from encoder.capture.motion.emotion import layer
from encoder.capture.motion.gestures import (
    GESTURE_RIG,
    GESTURES,
    INSIST,
    REACH,
    REST,
    SHAPES,
    TONGUE_GESTURES,
)
from encoder.capture.motion.style import Style
from encoder.capture.motion.upper_face import upper_face
from encoder.capture.speech.phones import LIP_CLOSING, PHONES, TEETH_TOUCHING, Phone
from sensors.types import FPS, SAMPLE_RATE, SAMPLES_PER_FRAME

JAW_UNIT = 0.43  # jawOpen of an open vowel, spoken loudly
JAW_LATE_S = 0.03  # tracked jaws lag their sound's energy by about a frame
JAW_LOUD = 0.35  # and hardly follow its louder half: nearer to decibels than to amplitude


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


def gesture_tracks(phones: list[Phone], times: np.ndarray, style: Style) -> dict[str, np.ndarray]:
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


def speaking_at(phones: list[Phone], times: np.ndarray) -> np.ndarray:
    """[T] 1 while a phone sounds, 0 when none is within 100 ms before or 160 ms after."""
    sounding = [p for p in phones if p.name != "pau"]
    if not sounding:
        return np.zeros(len(times))
    start = np.array([p.start for p in sounding])[:, None]
    end = np.array([p.end for p in sounding])[:, None]
    before, after = (start - times) / 0.1, (times - end) / 0.16
    outside = np.clip(np.maximum(before, after), 0, 1).min(0)
    return 0.5 + 0.5 * np.cos(np.pi * outside)


def open_mouth(
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


def tongue_curves(tracks: dict[str, np.ndarray], speaking: np.ndarray) -> np.ndarray:
    """Gesture tracks -> [T, 3] 0..1: tongueOut, tongueTipUp, tongueBackUp."""
    curves = np.stack([tracks[gesture] for gesture in TONGUE_GESTURES], 1)
    return np.clip(curves * speaking[:, None], 0, 1).astype(np.float32)


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
    speaking = speaking_at(phones, times)
    curves = np.zeros((len(level), len(RIG_NAMES)), np.float32)
    tongue = np.zeros((len(level), len(TONGUE_GESTURES)), np.float32)
    upper, gaze = upper_face(
        level * speaking, rng, reading=reading, brows=style.brows, blinks=style.blinks
    )
    mood, gain = layer(emotion, strength, level * speaking, rng)
    close = touch = np.zeros(len(times))
    if phones:
        moved = _jittered(phones, style.jitter_s, rng)
        tracks = gesture_tracks(moved, times, style)
        curves = gain * open_mouth(tracks, shifted, speaking, style)
        lips_meet = holds(phones, LIP_CLOSING, times, np.zeros(len(times), bool))
        shut = (times >= lips_meet[:, :1]) & (times <= lips_meet[:, 1:])
        lip_on_teeth = holds(phones, TEETH_TOUCHING, times, np.asarray(shut.any(0)))
        every = np.concatenate([lips_meet, lip_on_teeth])
        close = contact(lips_meet, every, times)
        touch = contact(lip_on_teeth, every, times)
        tongue = tongue_curves(tracks, speaking)
    curves = np.clip(curves + upper + mood, 0, 1)
    return Motion(np.clip(with_contacts(curves, close, touch, style, lips), 0, 1), gaze, tongue)


def _jittered(phones: list[Phone], spread_s: float, rng: np.random.Generator) -> list[Phone]:
    """Bounds moved by up to a few milliseconds, in order."""
    shift = rng.normal(0, spread_s, len(phones) + 1)
    return [
        Phone(p.name, p.start + shift[k], max(p.end + shift[k + 1], p.start + shift[k] + 0.01))
        for k, p in enumerate(phones)
    ]
