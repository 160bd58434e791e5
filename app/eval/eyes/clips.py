"""Rendered clips for the evaluation: a voice, rule-made motion and matching eye pictures.

Flow: sentence -> speech -> motion -> NearEye of a wearer that training never saw -> EyeClip.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sensors.types import FPS, NS, SAMPLES_PER_FRAME, SensorFrame

if TYPE_CHECKING:
    from encoder.eyes.routine import RoutineStep
    from render.near_eye.camera import NearEye, Wearer

FIRST_SEED = 1_000_000  # of wearers; training counts from 0
VOICE = "kal16"
TEXTS = (
    "Please keep the blue paper box by the big open door.",
    "My mother made a warm pie before we moved away.",
    "Five brave women are very often above the valley.",
    "Bob and Pam may remember the people on the boat.",
)
TAKE_FRAMES = 14  # drawn for each target of the calibration routine, once the eyes have settled


@dataclass(frozen=True, eq=False)
class EyeClip:
    """Sound and eye pictures of a clip of T frames, and their rule-made truth."""

    audio: NDArray[np.float32]  # [T, 1600] -1..1, 48 kHz
    eyes: NDArray[np.uint8]  # [T, 2, 400, 400]
    rig: NDArray[np.float32]  # [T, 53]
    gaze: NDArray[np.float32]  # [T, 2, 3] unit
    lids: NDArray[np.float32]  # [T, 2] opening as drawn
    routine: tuple[tuple["RoutineStep", NDArray[np.uint8]], ...]  # calibration: pictures [n, 2, ..]

    def frames(self, silent: bool = False) -> list[SensorFrame]:
        """The clip as sensor frames, on request without its sound."""
        return [
            SensorFrame(
                index=t,
                t_ns=(t + 1) * NS // FPS,
                audio=np.zeros_like(audio) if silent else audio,
                eyes=self.eyes[t],
                eyes_valid=np.ones(2, np.bool_),
                eyes_age_ns=np.zeros(2, np.int64),
                audio_gap=False,
            )
            for t, audio in enumerate(self.audio)
        ]


def make_clip(camera: "NearEye", number: int, seconds: float) -> EyeClip:
    """Render clip `number`; the number determines wearer, headset, sentence and motion."""
    from app.face.geometry import lips
    from encoder.capture.motion.rules import speech_curves
    from encoder.capture.motion.style import Style
    from encoder.capture.speech.synthesis import speak_flite
    from render.decoder import identity
    from render.decoder.learned import avatar_files
    from render.near_eye.look import Look, varied

    rng = np.random.default_rng([FIRST_SEED, number])
    spoken = speak_flite(TEXTS[number % len(TEXTS)], VOICE)
    sound = spoken.audio * np.float32(0.7 / max(float(np.abs(spoken.audio).max()), 1e-3))
    padding = max(int(seconds * FPS) * SAMPLES_PER_FRAME - len(sound), 0)
    sound = np.pad(sound, (0, padding))
    motion = speech_curves(spoken.phones, sound, Style.draw(rng), rng, lips=lips())
    count = min(len(motion.rig), int(seconds * FPS))
    people = [identity.load(name) for name in avatar_files.shipped()]
    wearer = camera.wear(varied(people, rng), Look.draw(rng), rng)
    pairs = [camera.draw(wearer, motion.rig[t], motion.gaze[t], rng) for t in range(count)]
    return EyeClip(
        sound[: count * SAMPLES_PER_FRAME].reshape(count, -1).astype(np.float32),
        np.stack([pair.pictures for pair in pairs]),
        motion.rig[:count].astype(np.float32),
        motion.gaze[:count].astype(np.float32),
        np.stack([pair.lids for pair in pairs]),
        _routine(camera, wearer, rng),
    )


def _routine(
    camera: "NearEye", wearer: "Wearer", rng: np.random.Generator
) -> tuple[tuple["RoutineStep", NDArray[np.uint8]], ...]:
    """The calibration routine: the wearer looks at each target, within half a degree, and closes
    the eyes."""
    from encoder.capture.motion.channels import RIG_INDEX
    from encoder.capture.motion.upper_face import looking
    from encoder.eyes.routine import ROUTINE

    parts: list[tuple[RoutineStep, NDArray[np.uint8]]] = []
    for target in (target for target in ROUTINE if target.name != "blink"):
        rig = looking(target.yaw_deg, target.pitch_deg)  # lids follow the gaze
        if target.name == "close":
            for side in "LR":
                rig[RIG_INDEX[f"eyeBlink_{side}"]] = 1
        pictures: list[NDArray[np.uint8]] = []
        for _ in range(TAKE_FRAMES):
            gaze = target.direction + np.array([*rng.normal(0, 0.008, 2), 0])
            gaze = np.tile(gaze / np.linalg.norm(gaze), (2, 1)).astype(np.float32)
            pictures.append(camera.draw(wearer, rig, gaze, rng).pictures)
        parts.append((target, np.stack(pictures)))
    return tuple(parts)
