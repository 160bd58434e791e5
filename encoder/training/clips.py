"""The clips of a data pack, and their features from the frozen audio encoder."""

from pathlib import Path

import numpy as np
from torch import Tensor

from encoder.audio.alignment import stack_of
from encoder.audio.encoder import AudioEncoder
from encoder.capture.dataset import Clip, read_pack


def grouped(pack: Path, split: str) -> dict[str, list[Clip]]:
    """The clips of a split, by kind of truth."""
    groups: dict[str, list[Clip]] = {}
    for clip in read_pack(pack, split):
        groups.setdefault(clip.truth, []).append(clip)
    return groups


def pick(clips: list[Clip], truth: str, rng: np.random.Generator) -> Clip:
    """A random clip. For tracked ones the voice is drawn first, with a probability that grows with
    the root of its number of clips: nearly all clips are of one speaker, other voices are hard."""
    if truth == "tracked":
        voices, counts = np.unique([clip.voice for clip in clips], return_counts=True)
        share = np.sqrt(counts) / np.sqrt(counts).sum()
        voice = rng.choice(voices, p=share)
        clips = [clip for clip in clips if clip.voice == voice]
    return clips[rng.integers(len(clips))]


def stacked(encoder: AudioEncoder, audio: Tensor) -> Tensor:
    """Sound [B, 800 T] at 24 kHz -> audio features [B, T, A] of each frame."""
    return stack_of(encoder.config)(encoder(audio[..., None]))
