"""Training data of what hears voices: clips of people and sounds without a voice, as the phonetic
encoder hears them.

Kept in the pack for reuse.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from tqdm import tqdm

from encoder.audio.encoder import AudioEncoder
from encoder.capture.dataset import PACK_SAMPLES_PER_FRAME, Clip, iter_pack
from encoder.capture.speech.handling import wind
from encoder.capture.speech.voice_like import VOICE_LIKE
from encoder.training.clips import stacked
from encoder.training.streams.augment import NOT_SPEECH, Crowd, crop, not_speech
from sensors.types import InputError

FRAMES = 300  # of a crop
PLAIN = 0.5  # share of the clips that are heard as they are
OTHERS_DB = (6, 26)  # that other voices are below a talker
KINDS = (*NOT_SPEECH, wind, wind, *VOICE_LIKE, *VOICE_LIKE)


@dataclass(frozen=True)
class HeardFrames:
    """Frames of crops, end to end."""

    heard: np.ndarray  # [N, D] float16 log-odds of the phonetic encoder
    people: np.ndarray  # [N] bool, somebody may talk


def hear(
    pack: Path,
    phones: AudioEncoder,
    recipe: str,  # of the encoder
    *,
    without: tuple[str, ...],  # talkers
    crops: tuple[int, int],  # of people, of other sounds
    seed: int,
) -> HeardFrames:
    """Frames of a pack, from its cache if that was made alike."""
    path = pack / "activity.npz"
    recipe = f"{recipe} {' '.join(without)} {crops} {seed}"
    if path.is_file():
        with np.load(path, allow_pickle=False) as data:
            if str(data["recipe"]) == recipe:
                return HeardFrames(data["heard"], data["people"])
    rows, people = list[np.ndarray](), list[np.ndarray]()
    parts = _parts(pack, without, crops, seed)
    for sound, talks in tqdm(parts, "sounds", sum(crops), mininterval=2):
        with torch.no_grad():
            rows.append(stacked(phones, torch.from_numpy(sound)[None])[0].numpy())
        people.append(np.full(len(rows[-1]), talks))
    frames = HeardFrames(np.concatenate(rows).astype(np.float16), np.concatenate(people))
    np.savez(path, recipe=np.array(recipe), **vars(frames))
    return frames


def _parts(
    pack: Path, without: tuple[str, ...], crops: tuple[int, int], seed: int
) -> Iterator[tuple[np.ndarray, bool]]:
    """Sounds [800 T] float32, and whether they are of people: each voice as often as any other."""
    voices: dict[str, list[Clip]] = {}
    for clip in iter_pack(pack, "train"):
        if clip.truth != "rest" and clip.voice not in without:
            voices.setdefault(clip.voice, []).append(clip)
    if not voices:
        raise InputError(f"{pack}: expected clips of people, got none; run `livedrive capture`")
    clips = list(voices.values())
    crowd = Crowd([clip.audio for some in clips for clip in some])
    for index in range(sum(crops)):
        rng = np.random.default_rng([seed, index])
        if index >= crops[0]:
            yield not_speech(FRAMES * PACK_SAMPLES_PER_FRAME, rng, KINDS), False
            continue
        some = clips[rng.integers(len(clips))]
        plain = rng.random() < PLAIN
        others = None if plain else crowd.talk
        clip = some[rng.integers(len(some))]
        part = crop(
            clip, min(clip.num_frames, FRAMES), rng, 0.0 if plain else 0.3, others, OTHERS_DB
        )
        yield part.audio, True
