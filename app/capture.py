"""`livedrive capture DIR`: the synthetic capture stage. Curves from encoder, pictures from render.

Without --session it makes a data pack for training; with it, a session whose speech, motion and
eye pictures are all ours, like recordings/demo. All its truth is rule-made.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from tyro.conf import Positional

if TYPE_CHECKING:
    from sensors.types import Packet

PAUSE_S = (0.6, 0.4, 0.9, 0.5)


@dataclass(kw_only=True)
class Capture:
    """Make training data, or a session."""

    folder: Positional[Path]
    """Folder to create."""
    session: tuple[str, ...] = ()
    """Sentences: make one session in which they are spoken."""
    voice: str = "slt"
    """Flite voice of the session: slt, rms, awb or kal16."""
    avatar: str = "ben"
    """Whose eyes the session's cameras see."""
    seconds: float | None = None
    """Cut the session to this length."""
    grid: tuple[Path, ...] = ()
    """GRID folders with tracked motion to add to the pack."""
    flite_minutes: float = 25.0
    espeak_minutes: float = 35.0
    rest_minutes: float = 12.0
    seed: int = 0

    def run(self) -> None:
        if self.session:
            self._make_session()
        else:
            self._make_pack()
        print(f"wrote {self.folder.resolve()}")

    def _make_pack(self) -> None:
        from encoder.capture.build import BuildConfig, build

        build(
            BuildConfig(
                folder=self.folder,
                flite_minutes=self.flite_minutes,
                espeak_minutes=self.espeak_minutes,
                rest_minutes=self.rest_minutes,
                grid=self.grid,
                seed=self.seed,
            )
        )

    def _make_session(self) -> None:
        from encoder.capture.motion import Style, speech_curves
        from encoder.capture.speech import Phone, Speech, speak_flite
        from sensors.recording import RecordingWriter
        from sensors.types import SAMPLE_RATE

        rng = np.random.default_rng(self.seed)
        audio, phones, length = [], [], 0
        for k, sentence in enumerate((*self.session, None)):
            pause = np.zeros(int(PAUSE_S[k % len(PAUSE_S)] * SAMPLE_RATE), np.float32)
            audio.append(pause)
            phones.append(Phone("pau", length / SAMPLE_RATE, (length + len(pause)) / SAMPLE_RATE))
            length += len(pause)
            if sentence is not None:
                said: Speech = speak_flite(sentence, self.voice)
                start = length / SAMPLE_RATE
                phones += [Phone(p.name, p.start + start, p.end + start) for p in said.phones]
                audio.append(said.audio)
                length += len(said.audio)
        sound = np.concatenate(audio)
        sound *= 0.7 / max(float(np.abs(sound).max()), 1e-3)
        rig, gaze = speech_curves(phones, sound, Style.draw(rng), rng)
        frames = len(sound) // 1600
        if self.seconds is not None:
            frames = min(frames, int(self.seconds * 30))
        with RecordingWriter(
            self.folder,
            created="",
            devices={"audio": f"flite {self.voice}", "eye_left": "simulated"},
            eye_codec="x264",
            audio_format="pcm16",
        ) as writer:
            for packet in self._packets(sound, rig, gaze, frames, rng):
                writer.append(packet)

    def _packets(
        self,
        sound: np.ndarray,  # [n] f32 at 48 kHz
        rig: np.ndarray,  # [T, 53]
        gaze: np.ndarray,  # [T, 2, 3]
        frames: int,
        rng: np.random.Generator,
    ) -> Iterator["Packet"]:
        from tqdm import tqdm

        from render import identity
        from render.decoder import Decoder
        from render.near_eye import draw_eyes
        from render.renderer import create_renderer
        from sensors.types import FPS, NS, SAMPLES_PER_FRAME, AudioPacket, EyePacket

        decoder, who, renderer = Decoder.load(), identity.load(self.avatar), create_renderer()
        for t in tqdm(range(frames), unit="frame", desc="capturing"):
            expression = decoder.encode(rig[t].astype(np.float32))
            _, gaussians = decoder.decode(expression, gaze[t].astype(np.float32), who)
            eyes = draw_eyes(gaussians, who.eye_centers, renderer, rng)
            first = t * SAMPLES_PER_FRAME
            samples = sound[first : first + SAMPLES_PER_FRAME].astype(np.float32)
            end_ns = (t + 1) * NS // FPS
            for eye in range(2):
                yield EyePacket(t_ns=end_ns, eye=eye, counter=t, image=eyes[eye])
            yield AudioPacket(t_ns=t * NS // FPS, first_sample=first, samples=samples)
        renderer.close()
