"""Training streams for the denoiser: features of the frozen audio encoder beside motion.

Between the audio stage and diffusion. Clips are distorted, joined into streams of about half a
minute (speech, rest, another voice), so that the encoder's gain adapts as it does live, and encoded
once, each stream with its own change of the vocal tract (`warped`).
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch
from tqdm import tqdm

from encoder.audio.encoder import AudioEncoder
from encoder.capture.dataset import PACK_SAMPLES_PER_FRAME, Clip, read_manifest
from encoder.capture.motion.channels import JAW_OPEN, RIG_INDEX, SPEECH_COLUMNS
from encoder.capture.motion.upper_face import upper_face
from encoder.nn.checkpoint import load
from encoder.training.checkpoints import load_encoder
from encoder.training.clips import REMOVE, grouped, pick, stacked
from encoder.training.geometry import TrainingFace
from encoder.training.streams.augment import crop, not_speech
from sensors import files
from sensors.types import FPS, InputError


@dataclass(frozen=True, kw_only=True)
class StreamSource:
    """What all streams are made of, and where they go."""

    pack: Path
    audio: Path  # the audio checkpoint, without suffix
    output: Path  # .npz to write
    stream_frames: int = 900
    seed: int = 0


@dataclass(frozen=True, kw_only=True)
class StreamConfig(StreamSource):
    minutes: float = 500.0
    rest_streams: float = 0.15  # share of streams without a word: loudness statistics die away
    clean_streams: float = 0.25  # share of streams as a good microphone hears them
    shares: tuple[tuple[str, float], ...] = (
        # rule-made lips move otherwise than people's: on talkers left out a linear map loses .07 of
        # r to as much of them as of tracked ones
        ("rules", 0.1),
        ("tracked", 0.75),  # an hour of real motion: each clip comes often, heard anew
        ("rest", 0.15),
    )


def draw_stream(
    groups: dict[str, list[Clip]],
    config: StreamConfig,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[str]]:
    """Random clips end to end: audio [800 T], rig [T, 53], gaze [T, 6], and of each frame the
    talker whose tracked motion it is, or ""; T = stream_frames."""
    names = [name for name, _ in config.shares if groups.get(name)]
    share = np.array([value for name, value in config.shares if name in names])
    distorted = 0.0 if rng.random() < config.clean_streams else 0.3
    audio, rig, voices, frames = [], [], list[str](), 0
    while frames < config.stream_frames:
        truth = str(rng.choice(names, p=share / share.sum()))
        clip = pick(groups[truth], truth, rng)
        length = min(clip.num_frames, 300)
        part = crop(clip, length, rng, distorted)
        audio.append(part.audio)
        rig.append(part.rig)
        voices += [clip.voice if truth == "tracked" else ""] * length
        frames += length
    samples = config.stream_frames * PACK_SAMPLES_PER_FRAME
    sound, curves = np.concatenate(audio)[:samples], np.concatenate(rig)[: config.stream_frames]
    if rng.random() < config.rest_streams:
        sound, curves = not_speech(samples, rng), np.zeros_like(curves)
    # eyes, lids and brows anew for the whole stream: no jumps of the gaze where clips meet
    upper, gaze = upper_face(np.clip(curves[:, JAW_OPEN] / 0.35, 0, 1), rng)
    upper[:, SPEECH_COLUMNS] = curves[:, SPEECH_COLUMNS]
    return sound, upper, gaze.reshape(-1, 6), voices[: config.stream_frames]


WARPS = (0.85, 1.17)  # of the vocal tract's length, as heard
WARPED = 0.6  # share of streams


def check_left_out(names: Sequence[str], talkers: Sequence[str]) -> None:
    """Raise InputError where one of these is no talker."""
    for name in names:
        if name not in talkers:
            raise InputError(f"--leave-out: expected one of {', '.join(talkers)}, got {name!r}")


def warped(encoder: AudioEncoder, rng: np.random.Generator | None) -> AudioEncoder:
    """The encoder for this stream: it hears all voices with a changed vocal tract; without rng, as
    they are."""
    for part in (encoder, encoder.second):
        if part is not None and part.spectrum:
            warp = float(rng.uniform(*WARPS)) if rng and rng.random() < WARPED else 1.0
            bank = torch.from_numpy(part.spectrum.config.bank(warp))
            part.spectrum.bank.copy_(bank)
    return encoder


def run(config: StreamConfig) -> Path:
    """Encode and write features [S, T, A], rig [S, T, 53], gaze [S, T, 6], all float16, and voices
    [S, T] int16, an index of the names in `about`."""
    groups, encoder = grouped(config.pack, "train"), load_encoder(config.audio)
    count = max(1, round(config.minutes * 1800 / config.stream_frames))
    rows, names = [], [""]
    for index in tqdm(range(count), desc="streams", mininterval=2):
        rng = np.random.default_rng([config.seed, index])
        audio, rig, gaze, voices = draw_stream(groups, config, rng)
        names += sorted(set(voices) - set(names))
        with torch.no_grad():
            features = stacked(warped(encoder, rng), torch.tensor(audio)[None])[0].numpy()
        whose = np.array([names.index(voice) for voice in voices], np.int16)
        rows.append([*(array.astype(np.float16) for array in (features, rig, gaze)), whose])
    features, rig, gaze, voices = (np.stack(arrays) for arrays in zip(*rows, strict=True))
    config.output.parent.mkdir(parents=True, exist_ok=True)
    about = {"sources": read_manifest(config.pack)["sources"], "voices": names}
    words = np.array(json.dumps(about | made_from(config)))
    with files.replacing(config.output) as draft:
        np.savez(draft, features=features, rig=rig, gaze=gaze, voices=voices, about=words)
    return config.output


class StreamOrigin(Protocol):
    """Sources and settings of both kinds of streams."""

    @property
    def audio(self) -> Path: ...
    @property
    def output(self) -> Path: ...
    @property
    def minutes(self) -> float: ...
    @property
    def seed(self) -> int: ...


def made_from(config: StreamOrigin) -> dict[str, Any]:
    """What streams depend on besides the pack: encoder, seed and settings.

    Raises InputError where there is no whole encoder."""
    audio = load(config.audio, "audio", "centred")[1]["sha256"]
    return {"audio_sha256": audio, "minutes": config.minutes, "seed": config.seed}


def are_made(config: StreamOrigin, *, resumed: bool = False) -> bool:
    """Whether the output already holds the streams of this config, whole.

    Raises InputError where a run that is resumed finds those of another one."""
    if not config.output.is_file():
        return False
    try:
        with files.arrays(config.output, REMOVE) as data:
            about = json.loads(str(data["about"])) if "about" in data else {}
    except InputError:
        return False
    made = made_from(config).items() <= about.items()
    if resumed and not made:
        raise InputError(
            f"--resume: expected the streams of that run in {config.output}, got others; repeat "
            f"its settings, or run the stage without --resume"
        )
    return made


BLINK = RIG_INDEX["eyeBlink_L"]
BLINK_WEIGHT = 3.0  # short and often a guess: a mean of guesses never shuts an eye
REST_WEIGHT = 2.0  # a mouth that moves in silence is obvious
# Gaze varies by a tenth: training shows (gaze - ahead) * 10, so that it is learned like the rest.
# `fold_gaze` in diffusion.py moves this map into the weights that are saved.
AHEAD = (0.0, 0.0, 1.0, 0.0, 0.0, 1.0)
GAZE_SCALE = 10.0
REDRAWN = 10_000  # times, until no window of a batch holds a talker who is left out


@dataclass(frozen=True)
class Streams:
    """Training data of the denoiser, in memory; codes are not standardised."""

    features: np.ndarray  # [S, T, A] float16
    codes: np.ndarray  # [S, T, 256] float32
    gaze: np.ndarray  # [S, T, 6] float16
    weight: np.ndarray  # [S, T] float32, of a frame's error
    about: dict[str, Any]  # "sources": what was heard and seen -> its licence; "audio_sha256"
    barred: np.ndarray | None = None  # [S, T] bool: frames that no window may hold

    @staticmethod
    def load(path: Path, face: TrainingFace, without: tuple[str, ...] = ()) -> "Streams":
        """`without`: talkers whose tracked motion stays unseen and unheard."""
        with files.arrays(path, REMOVE) as data:
            rig = data["rig"].astype(np.float32)
            codes = face.rig_to_code(rig).astype(np.float32)
            rest = rig[..., list(SPEECH_COLUMNS)].max(-1) < 0.01
            weight = np.where(rest, REST_WEIGHT, 1.0).astype(np.float32)
            weight = np.where(rig[..., BLINK] > 0.4, np.float32(BLINK_WEIGHT), weight)
            about = json.loads(str(data["about"]))
            barred = None
            if without:
                check_left_out(without, about["voices"][1:])
                barred = np.isin(data["voices"], [about["voices"].index(name) for name in without])
            return Streams(data["features"], codes, data["gaze"], weight, about, barred)

    @property
    def allowed(self) -> np.ndarray:  # [S, T] bool
        return np.ones(self.codes.shape[:2], bool) if self.barred is None else ~self.barred

    def draw(
        self, batch: int, frames: int, rng: np.random.Generator, ahead: int = 0
    ) -> tuple[torch.Tensor, ...]:
        """Random windows: codes [B, T, 256], audio [B, T, A], scaled gaze [B, T, 6], weight.

        ahead: frames of sound from the future that each frame hears.
        """
        length = frames + ahead
        stream, start = self._places(batch, length, rng)
        if self.barred is not None:
            for _ in range(REDRAWN):
                windows = zip(stream, start, strict=True)
                bad = np.array([self.barred[s, t : t + length].any() for s, t in windows])
                if not bad.any():
                    break
                stream[bad], start[bad] = self._places(int(bad.sum()), length, rng)
            else:
                raise InputError(
                    f"--leave-out: expected {length / FPS:g} s without these talkers in the "
                    "streams, got none; leave fewer out"
                )
        arrays = ((self.codes, 0), (self.features, ahead), (self.gaze, 0), (self.weight, 0))
        codes, audio, gaze, weight = (
            torch.tensor(
                np.stack(
                    [a[s, t + k : t + k + frames] for s, t in zip(stream, start, strict=True)]
                ),
                dtype=torch.float32,
            )
            for a, k in arrays
        )
        return codes, audio, (gaze - torch.tensor(AHEAD)) * GAZE_SCALE, weight

    def _places(
        self, count: int, length: int, rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray]:
        stream = rng.integers(len(self.codes), size=count)
        return stream, rng.integers(self.codes.shape[1] - length + 1, size=count)
