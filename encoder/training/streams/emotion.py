"""Training streams for emotions: features of the frozen audio encoder beside emotional truth.

Half the streams are acted takes of one label, with the voice that goes with it. In the others
voice and motion are neutral (rules, a face tracker, rest), and the truth is made by adding several
emotions to the motion: a user may choose any emotion, however the voice sounds.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from tqdm import tqdm

from encoder.capture.dataset import PACK_SAMPLES_PER_FRAME, Clip, read_manifest
from encoder.capture.motion.channels import JAW_OPEN, MOUTH_CLOSE, SPEECH_COLUMNS
from encoder.capture.motion.contacts import LipGeometry
from encoder.capture.motion.emotion import layer
from encoder.emotion.labels import LABELS
from encoder.training.checkpoints import load_encoder
from encoder.training.clips import REMOVE, grouped, stacked
from encoder.training.geometry import TrainingFace
from encoder.training.streams.augment import crop
from encoder.training.streams.streams import (
    AHEAD,
    GAZE_SCALE,
    StreamSource,
    made_from,
)
from sensors import files

ACTED_STRENGTH = 0.9  # the mean of the takes' own, which the pack does not keep
# Mean share of the strength that the layer shows, as it swells and ebbs. Intensity 1 is the whole
# of an emotion's action units, and so a take of strength 1 has intensity SWELL.
SWELL = 0.72
NEAR_MM = 2.0  # closer lips are about to shut or have just opened
SHARES = {"rules": 0.4, "tracked": 0.5, "rest": 0.1}  # of the neutral streams


@dataclass(frozen=True, kw_only=True)
class EmotionStreamConfig(StreamSource):
    minutes: float = 240.0
    versions: int = 4  # emotions laid over each stream
    acted: float = 0.5  # share of acted streams


def with_emotion(
    rig: np.ndarray,  # [T, 53] without emotion
    label: str,
    strength: float,  # 0..1
    lips: LipGeometry,
    rng: np.random.Generator,
) -> np.ndarray:
    """Rig [T, 53] with the capture stage's layer of this emotion; shut lips stay shut."""
    level = np.clip(rig[:, JAW_OPEN] / 0.35, 0, 1)
    added, gain = layer(label, strength, level, rng)
    columns = list(SPEECH_COLUMNS)
    result = rig.copy()
    result[:, columns] *= gain
    result = np.clip(result + added, 0, 1)
    before, after = lips.gap_mm(rig), lips.gap_mm(result)
    near = np.clip(1 - before / NEAR_MM, 0, 1)
    wanted = np.minimum(after, (1 - near) * after + near * np.minimum(before, after))
    busy = wanted < after - 1e-3
    if busy.any():
        result[busy, MOUTH_CLOSE] = lips.closed(result[busy], wanted[busy])
    return result


def draw_stream(
    groups: dict[str, list[Clip]], config: EmotionStreamConfig, index: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, str]:
    """Random clips end to end: audio [800 T], rig [T, 53], gaze [T, 6], acted label or ""."""
    rng = np.random.default_rng([config.seed, index])
    label = LABELS[index % len(LABELS)] if rng.random() < config.acted else ""
    names = [name for name in SHARES if groups.get(name)]
    share = np.array([SHARES[name] for name in names])
    acted = [clip for clip in groups.get("emotional", []) if clip.emotion == label]
    label = label if acted else ""
    audio, rig, gaze, frames = [], [], [], 0
    while frames < config.stream_frames:
        clips = acted or groups[str(rng.choice(names, p=share / share.sum()))]
        clip = clips[rng.integers(len(clips))]
        length = max(1, min(int(clip.num_frames / 1.25), 300))  # pitch takes up to 1.2 times
        part = crop(clip, length, rng)
        audio.append(part.audio)
        rig.append(part.rig)
        gaze.append(part.gaze.reshape(-1, 6))
        frames += length
    samples = config.stream_frames * PACK_SAMPLES_PER_FRAME
    curves, looks = (np.concatenate(rows)[: config.stream_frames] for rows in (rig, gaze))
    return np.concatenate(audio)[:samples], curves, looks, label


def run(config: EmotionStreamConfig, lips: LipGeometry) -> Path:
    """Encode and write features [S, T, A], rig [S, N, T, 53], gaze [S, T, 6], all float16, and
    mixture [S, N, labels], the intensities that each of the N versions of a stream's rig shows."""
    groups = grouped(config.pack, "train")
    encoder = load_encoder(config.audio)
    count = max(1, round(config.minutes * 1800 / config.stream_frames))
    rows: list[tuple[np.ndarray, ...]] = []
    for index in tqdm(range(count), desc="emotion streams", mininterval=2):
        audio, rig, gaze, acted = draw_stream(groups, config, index)
        with torch.no_grad():
            features = stacked(encoder, torch.tensor(audio)[None])[0].numpy()
        rng = np.random.default_rng([config.seed, index, 1])
        rigs, mixtures = [], np.zeros((config.versions, len(LABELS)), np.float32)
        chosen = rng.permutation(len(LABELS))
        for version in range(config.versions):
            if acted:
                rigs.append(rig)
                mixtures[version, LABELS.index(acted)] = SWELL * ACTED_STRENGTH
                continue
            label, strength = int(chosen[version % len(LABELS)]), float(rng.uniform(0.25, 1.1))
            rigs.append(with_emotion(rig, LABELS[label], strength, lips, rng))
            mixtures[version, label] = SWELL * strength
        halves = [x.astype(np.float16) for x in (features, np.stack(rigs), gaze)]
        rows.append((*halves, mixtures))
    features, rig, gaze, mixture = (np.stack(arrays) for arrays in zip(*rows, strict=True))
    config.output.parent.mkdir(parents=True, exist_ok=True)
    about = json.dumps({"sources": read_manifest(config.pack)["sources"], **made_from(config)})
    with files.replacing(config.output) as draft:
        np.savez(
            draft, features=features, rig=rig, gaze=gaze, mixture=mixture, about=np.array(about)
        )
    return config.output


@dataclass(frozen=True)
class EmotionStreams:
    """Training data of the zero convolutions, in memory."""

    features: np.ndarray  # [S, T, A] float16
    rig: np.ndarray  # [S, N, T, 53] float16
    gaze: np.ndarray  # [S, T, 6] float16
    mixture: np.ndarray  # [S, N, labels] float32
    about: dict[str, Any]  # "sources": name -> licence; "audio_sha256"

    @staticmethod
    def load(path: Path) -> "EmotionStreams":
        with files.arrays(path, REMOVE) as data:
            about = json.loads(str(data["about"]))
            return EmotionStreams(
                data["features"], data["rig"], data["gaze"], data["mixture"], about
            )

    def draw(
        self, batch: int, frames: int, face: TrainingFace, rng: np.random.Generator
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
        """Random windows: codes [B, T, 256], audio [B, T, A], scaled gaze [B, T, 6], mixture."""
        stream = rng.integers(len(self.rig), size=batch)
        version = rng.integers(self.rig.shape[1], size=batch)
        start = rng.integers(self.rig.shape[2] - frames + 1, size=batch)
        places = list(zip(stream, version, start, strict=True))
        rig, audio, gaze = (
            np.stack(rows).astype(np.float32)
            for rows in (
                [self.rig[s, v, t : t + frames] for s, v, t in places],
                [self.features[s, t : t + frames] for s, _, t in places],
                [self.gaze[s, t : t + frames] for s, _, t in places],
            )
        )
        codes = torch.from_numpy(face.rig_to_code(rig))
        scaled = (torch.from_numpy(gaze) - torch.tensor(AHEAD)) * GAZE_SCALE
        mixture = torch.from_numpy(self.mixture[stream, version])
        return codes, torch.from_numpy(audio), scaled, mixture
