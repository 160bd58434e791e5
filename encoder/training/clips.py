"""The clips of a data pack, and their features from the frozen audio encoder."""

from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from torch import Tensor

from encoder.audio.alignment import stack_of
from encoder.audio.encoder import AudioEncoder
from encoder.capture.dataset import Clip, read_pack
from sensors import files
from sensors.types import InputError

REMOVE = "remove it, and train again: it is made anew"
Frames = TypeVar("Frames")


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


def kept(path: Path, recipe: str, kind: type[Frames], *, resumed: bool) -> Frames | None:
    """What `keep` wrote there, where that is whole and of this recipe; `kind` is its dataclass.

    Raises InputError where a run that is resumed finds what another one heard."""
    made = recipe
    with suppress(FileNotFoundError, InputError), files.arrays(path, REMOVE) as data:
        if (made := str(data["recipe"])) == recipe:
            return kind(**{name: data[name] for name in kind.__annotations__})
    if resumed and made != recipe:
        raise InputError(
            f"--resume: expected what that run heard in {path}, got what another did; repeat its "
            "settings, or remove that file: it is made anew"
        )
    return None


def keep(path: Path, recipe: str, frames: Any) -> None:
    """Write the arrays of a dataclass, and what they were made by."""
    with files.replacing(path) as draft:
        np.savez(draft, recipe=np.array(recipe), **vars(frames))
