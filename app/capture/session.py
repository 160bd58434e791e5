"""`livedrive capture session DIR`: one session whose sound, motion and eye pictures are all ours.

Flow: sentences -> speech -> motion -> near-eye pictures, head poses -> RecordingWriter, like
recordings/demo.
The truth goes beside it in motion.npz; it is rule-made.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sensors.session.format import MOTION_FILE
from sensors.types import (
    FPS,
    NS,
    SAMPLES_PER_FRAME,
    AudioPacket,
    EyePacket,
    HeadPacket,
    HeadPose,
    InputError,
    Packet,
)

if TYPE_CHECKING:
    from encoder.capture.motion.rules import Motion
    from render.decoder.identity import Identity


@dataclass(frozen=True, kw_only=True)
class SessionSettings:
    text: tuple[str, ...]  # sentences to say
    voice: str = "slt"  # of flite
    avatar: str = "ben"  # whose eyes
    seconds: float | None = None  # cut to this length
    seed: int = 0


def make_session(folder: Path, settings: SessionSettings) -> None:
    """Write the session; raise InputError without sentences, for an unknown avatar or voice, and
    for no seconds."""
    from app.face.geometry import lips
    from encoder.capture.made import join
    from encoder.capture.motion.channels import RIG_NAMES, TONGUE_NAMES
    from encoder.capture.motion.rules import Style, speech_curves
    from encoder.capture.speech.synthesis import speak_flite
    from render.decoder import identity
    from sensors.session.files import whole

    if not settings.text:
        raise InputError(
            "capture session: expected sentences, got none; pass --text 'Hello there.'"
        )
    if settings.seconds is not None and not 1 / FPS <= settings.seconds < inf:
        raise InputError(
            f"--seconds: expected a frame or more, got {settings.seconds:g} s; try --seconds 10"
        )
    who = identity.load(settings.avatar)  # before there is a folder
    rng = np.random.default_rng(settings.seed)
    spoken = [speak_flite(text, settings.voice) for text in settings.text]
    speech = join(spoken, (0.4, 0.9), rng)
    sound = speech.audio * np.float32(0.7 / max(float(np.abs(speech.audio).max()), 1e-3))
    motion = speech_curves(speech.phones, sound, Style.draw(rng), rng, lips=lips())
    frames = len(motion.rig)
    if settings.seconds is not None:
        frames = min(frames, int(settings.seconds * FPS))
    devices = {
        "audio": f"flite {settings.voice}",
        "eye_left": "simulated",
        "eye_right": "simulated",
        "head": "simulated",
    }
    with whole(
        folder, created="", devices=devices, eye_codec="x264", audio_format="pcm16"
    ) as writer:
        for packet in _packets(sound, motion, frames, who, settings.seed, rng):
            writer.append(packet)
        np.savez_compressed(
            folder / MOTION_FILE,
            rig=motion.rig[:frames].astype(np.float16),
            tongue=motion.tongue[:frames].astype(np.float16),
            gaze=motion.gaze[:frames].astype(np.float16),
            rig_names=np.array(RIG_NAMES),
            tongue_names=np.array(TONGUE_NAMES),
        )
    print(f"wrote {folder.resolve()}")


def _packets(
    sound: NDArray[np.float32],  # [n] at 48 kHz
    motion: "Motion",
    frames: int,
    who: "Identity",
    seed: int,
    rng: np.random.Generator,
) -> Iterator[Packet]:
    from tqdm import tqdm

    from render.decoder.decoder import Decoder
    from render.near_eye.camera import NearEye
    from render.near_eye.look import Look

    renderer = NearEye(Decoder.load())
    heads = head_poses(sound, frames, seed)
    wearer = renderer.wear(who, Look.draw(rng), rng)
    for t in tqdm(range(frames), unit="frame", desc="capturing"):
        eyes = renderer.draw(wearer, motion.rig[t], motion.gaze[t], rng).pictures
        first = t * SAMPLES_PER_FRAME
        samples = sound[first : first + SAMPLES_PER_FRAME].astype(np.float32)
        end_ns = (t + 1) * NS // FPS
        for eye in range(2):
            yield EyePacket(t_ns=end_ns, eye=eye, counter=t, image=eyes[eye])
        yield heads[t]
        yield AudioPacket(t_ns=t * NS // FPS, first_sample=first, samples=samples)
    renderer.close()


def head_poses(
    sound: NDArray[np.float32],  # [n] at 48 kHz
    frames: int,
    seed: int,
) -> list[HeadPacket]:
    """How somebody who says this holds the head, a pose a frame: rule-made, by encoder/alive."""
    from encoder.alive import motion, prosody
    from sensors import rotation

    heard, moved, packets = prosody.init_state(), motion.MotionState(), list[HeadPacket]()
    padded = np.pad(sound.astype(np.float32), (0, SAMPLES_PER_FRAME))
    for t in range(frames):
        samples = padded[t * SAMPLES_PER_FRAME : (t + 1) * SAMPLES_PER_FRAME]
        said, heard = prosody.step(samples, heard)
        angles, _, moved = motion.step(t, said, None, seed, moved)
        pose = HeadPose(quat=rotation.from_angles(angles))
        packets.append(HeadPacket((t + 1) * NS // FPS, pose))
    return packets
