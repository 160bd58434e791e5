"""Training streams for the denoiser: features of the frozen audio encoder beside motion.

Between the audio stage and diffusion. Clips are distorted, joined into streams of about half a
minute (speech, rest, another voice), so the encoder's running statistics meet what they meet live,
and encoded once. Voices without tracked motion get labels from the audio stage's own mouth head.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch
from tqdm import tqdm

from encoder.audio_encoder import AudioEncoder
from encoder.capture.channels import JAW_OPEN, MOUTH_CLOSE, RIG_INDEX, SPEECH_COLUMNS
from encoder.capture.dataset import PACK_SAMPLES_PER_FRAME, Clip, read_manifest
from encoder.capture.motion import closing_weight, upper_face
from encoder.training.audio import grouped, load_encoder, pick, stacked
from encoder.training.augment import Crop, crop, not_speech
from encoder.training.geometry import Face
from encoder.training.heads import Heads, Outputs, load_heads


@dataclass(frozen=True, kw_only=True)
class StreamConfig:
    pack: Path
    audio: Path  # the audio checkpoint, without suffix
    heads: Path  # the heads of the audio stage, for labels of real voices
    output: Path  # .npz to write
    minutes: float = 500.0
    stream_frames: int = 900
    seed: int = 0
    rest_streams: float = 0.15  # share of streams without a word: loudness statistics die away
    clean_streams: float = 0.25  # share of streams as a good microphone hears them
    shares: tuple[tuple[str, float], ...] = (
        ("rules", 0.33),
        ("tracked", 0.52),  # an hour of real motion: each clip comes often, heard anew
        ("envelope", 0.03),  # timid: labelled by the audio stage's heads
        ("rest", 0.12),
    )


def labelled(part: Crop, truth: str, predict: Outputs) -> np.ndarray:
    """The crop's curves [T, 53]; a real voice's mouth is what the rule-trained head hears in it."""
    if truth != "envelope":
        return part.rig
    rig = part.rig.copy()
    loud = rig[:, JAW_OPEN]
    mouth = predict(part.clean)["rules"]
    padded = np.pad(mouth, ((1, 1), (0, 0)), mode="edge")
    mouth = 0.25 * padded[:-2] + 0.5 * mouth + 0.25 * padded[2:]
    # speaking: the loudness was up within 5 frames before or 3 after
    near = np.convolve(loud > 0.02, np.ones(9), mode="full")[3 : 3 + len(loud)]
    gate = np.convolve(near > 0, [0.25, 0.5, 0.25], mode="same")
    columns = list(SPEECH_COLUMNS)
    rig[:, columns] = np.clip(mouth, 0, 1) * gate[:, None]
    rig[:, JAW_OPEN] = gate * np.clip(0.5 * rig[:, JAW_OPEN] + 0.5 * loud, 0, 0.6)
    rig[:, MOUTH_CLOSE] = np.minimum(rig[:, MOUTH_CLOSE], closing_weight(rig))
    return rig


def draw_stream(
    groups: dict[str, list[Clip]],
    config: StreamConfig,
    predict: Outputs,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Random clips end to end: audio [800 T], rig [T, 53], gaze [T, 6]; T = stream_frames."""
    names = [name for name, _ in config.shares if groups.get(name)]
    share = np.array([value for name, value in config.shares if name in names])
    distorted = 0.0 if rng.random() < config.clean_streams else 0.3
    audio, rig, frames = [], [], 0
    while frames < config.stream_frames:
        truth = str(rng.choice(names, p=share / share.sum()))
        clip = pick(groups[truth], truth, rng)
        length = min(clip.num_frames, 300)
        part = crop(clip, length, rng, distorted)
        audio.append(part.audio)
        rig.append(labelled(part, truth, predict))
        frames += length
    samples = config.stream_frames * PACK_SAMPLES_PER_FRAME
    sound, curves = np.concatenate(audio)[:samples], np.concatenate(rig)[: config.stream_frames]
    if rng.random() < config.rest_streams:
        sound, curves = not_speech(samples, rng), np.zeros_like(curves)
    # eyes, lids and brows anew for the whole stream: no jumps of the gaze where clips meet
    upper, gaze = upper_face(np.clip(curves[:, JAW_OPEN] / 0.35, 0, 1), rng)
    upper[:, SPEECH_COLUMNS] = curves[:, SPEECH_COLUMNS]
    return sound, upper, gaze.reshape(-1, 6)


def run(config: StreamConfig) -> Path:
    """Encode and write features [S, T, A], rig [S, T, 53], gaze [S, T, 6], all float16."""
    groups = grouped(config.pack, "train")
    encoder, heads = load_encoder(config.audio), load_heads(config.heads)
    predict = _predictor(encoder, heads)
    count = max(1, round(config.minutes * 1800 / config.stream_frames))
    rows = []
    for index in tqdm(range(count), desc="streams", mininterval=2):
        rng = np.random.default_rng([config.seed, index])
        audio, rig, gaze = draw_stream(groups, config, predict, rng)
        with torch.no_grad():
            features = stacked(encoder, torch.tensor(audio)[None])[0].numpy()
        rows.append([array.astype(np.float16) for array in (features, rig, gaze)])
    features, rig, gaze = (np.stack(arrays) for arrays in zip(*rows, strict=True))
    config.output.parent.mkdir(parents=True, exist_ok=True)
    about = json.dumps({"sources": read_manifest(config.pack)["sources"], **made_from(config)})
    np.savez(config.output, features=features, rig=rig, gaze=gaze, about=np.array(about))
    return config.output


class Recipe(Protocol):
    """What both kinds of streams are made from."""

    @property
    def audio(self) -> Path: ...
    @property
    def output(self) -> Path: ...
    @property
    def minutes(self) -> float: ...
    @property
    def seed(self) -> int: ...


def made_from(config: Recipe) -> dict[str, Any]:
    """What streams depend on beside the pack: another encoder or seed makes other streams."""
    audio = json.loads(config.audio.with_suffix(".json").read_text())["sha256"]
    return {"audio_sha256": audio, "minutes": config.minutes, "seed": config.seed}


def are_made(config: Recipe) -> bool:
    """Do the streams of this config lie in its output already?"""
    if not config.output.is_file():
        return False
    with np.load(config.output, allow_pickle=False) as data:
        about = json.loads(str(data["about"])) if "about" in data else {}
    return made_from(config).items() <= about.items()


def _predictor(encoder: AudioEncoder, heads: Heads) -> Outputs:
    @torch.no_grad()
    def predict(audio: np.ndarray) -> dict[str, np.ndarray]:
        features = stacked(encoder, torch.tensor(audio, dtype=torch.float32)[None])
        return {name: value[0].numpy() for name, value in heads(features).items()}

    return predict


BLINK = RIG_INDEX["eyeBlink_L"]
BLINK_WEIGHT = 3.0  # short and often a guess: a mean of guesses never shuts an eye
REST_WEIGHT = 2.0  # a mouth that moves in silence is seen at once
# Gaze varies by a tenth: training shows (gaze - ahead) * 10, so that it is learned like the rest.
# `fold_gaze` in diffusion.py moves this map into the weights that are saved.
AHEAD = (0.0, 0.0, 1.0, 0.0, 0.0, 1.0)
GAZE_SCALE = 10.0


@dataclass(frozen=True)
class Streams:
    """What the denoiser learns from, in memory. codes are not standardised."""

    features: np.ndarray  # [S, T, A] float16
    codes: np.ndarray  # [S, T, 256] float32
    gaze: np.ndarray  # [S, T, 6] float16
    weight: np.ndarray  # [S, T] float32, of a frame's error
    about: dict[str, Any]  # "sources": what was heard and seen -> its licence; "audio_sha256"

    @staticmethod
    def load(path: Path, face: Face) -> "Streams":
        with np.load(path, allow_pickle=False) as data:
            rig = data["rig"].astype(np.float32)
            codes = face.rig_to_code(rig).astype(np.float32)
            rest = rig[..., list(SPEECH_COLUMNS)].max(-1) < 0.01
            weight = np.where(rest, REST_WEIGHT, 1.0).astype(np.float32)
            weight = np.where(rig[..., BLINK] > 0.4, np.float32(BLINK_WEIGHT), weight)
            about = json.loads(str(data["about"]))
            return Streams(data["features"], codes, data["gaze"], weight, about)

    def draw(
        self, batch: int, frames: int, rng: np.random.Generator, ahead: int = 0
    ) -> tuple[torch.Tensor, ...]:
        """Random windows: codes [B, T, 256], audio [B, T, A], scaled gaze [B, T, 6], weight.

        ahead: frames of sound from the future that each frame hears.
        """
        stream = rng.integers(len(self.codes), size=batch)
        start = rng.integers(self.codes.shape[1] - frames - ahead + 1, size=batch)
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
