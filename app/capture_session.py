"""`livedrive capture session DIR`: one session whose sound, motion and eye pictures are all ours.

Flow: sentences -> speech -> motion -> near-eye pictures -> RecordingWriter, like recordings/demo.
The truth goes beside it in motion.npz; it is rule-made.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sensors.types import FPS, NS, SAMPLES_PER_FRAME, AudioPacket, EyePacket, InputError, Packet

if TYPE_CHECKING:
    from app.capture import Capture
    from encoder.capture.motion import Motion


def make_session(folder: Path, command: "Capture") -> None:
    """Write the session; raise InputError without sentences."""
    from app.capture_face import lips
    from encoder.capture.channels import RIG_NAMES, TONGUE_NAMES
    from encoder.capture.made import join
    from encoder.capture.motion import Style, speech_curves
    from encoder.capture.speech import speak_flite
    from sensors.recording import RecordingWriter

    if not command.text:
        raise InputError(
            "capture session: expected sentences, got none; pass --text 'Hello there.'"
        )
    rng = np.random.default_rng(command.seed)
    spoken = [speak_flite(text, command.voice) for text in command.text]
    speech = join(spoken, (0.4, 0.9), rng)
    sound = speech.audio * np.float32(0.7 / max(float(np.abs(speech.audio).max()), 1e-3))
    motion = speech_curves(speech.phones, sound, Style.draw(rng), rng, lips=lips())
    frames = len(motion.rig)
    if command.seconds is not None:
        frames = min(frames, int(command.seconds * FPS))
    devices = {"audio": f"flite {command.voice}", "eye_left": "simulated", "eye_right": "simulated"}
    with RecordingWriter(
        folder, created="", devices=devices, eye_codec="x264", audio_format="pcm16"
    ) as writer:
        for packet in _packets(sound, motion, frames, command, rng):
            writer.append(packet)
    np.savez_compressed(
        folder / "motion.npz",
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
    command: "Capture",
    rng: np.random.Generator,
) -> Iterator[Packet]:
    from tqdm import tqdm

    from render import identity
    from render.decoder import Decoder
    from render.near_eye import NearEye
    from render.near_eye_look import Look

    renderer = NearEye(Decoder.load())
    wearer = renderer.wear(identity.load(command.avatar), Look.draw(rng), rng)
    for t in tqdm(range(frames), unit="frame", desc="capturing"):
        eyes = renderer.draw(wearer, motion.rig[t], motion.gaze[t], rng).pictures
        first = t * SAMPLES_PER_FRAME
        samples = sound[first : first + SAMPLES_PER_FRAME].astype(np.float32)
        end_ns = (t + 1) * NS // FPS
        for eye in range(2):
            yield EyePacket(t_ns=end_ns, eye=eye, counter=t, image=eyes[eye])
        yield AudioPacket(t_ns=t * NS // FPS, first_sample=first, samples=samples)
    renderer.close()
