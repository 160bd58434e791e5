"""Training data of the direct path: phones heard in each frame, and the mouth's motion.

Each clip is heard from its start through random microphones and rooms, some while other people
talk, without a break or in syllables and pauses; with it come the codes of the old chain for the
same sound, and many kinds of sounds without a voice. Kept in the pack for reuse.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from tqdm import tqdm

from encoder.audio.encoder import AudioEncoder
from encoder.capture.dataset import PACK_SAMPLES_PER_FRAME, Clip, iter_pack
from encoder.denoiser.model import Denoiser
from encoder.training.clips import keep, kept, stacked
from encoder.training.streams.augment import (
    NOT_SPEECH,
    OTHERS_DB,
    Crop,
    Crowd,
    Noise,
    clicks,
    crop,
    not_speech,
)
from encoder.training.streams.streams import AHEAD, check_left_out, warped

CLEAN = 0.25  # share of clips as a good microphone hears them
LONGEST = 300  # frames of a clip
RARE = 3  # times as many versions of a talker who has few clips
RULES_KEPT = 0.3  # share of rule-made clips that are heard, to save time
ALIKE = 0.5  # share of tracked clips whose other voices say words and pauses like theirs
PLAIN_DB = (6, 14)  # that other voices are below a plain clip
TRACKED_DB = (2, 18)  # below a tracked clip
AMONG = 2  # versions of a tracked clip among others, for what hears voices
AMONG_DB = (4, 14)  # that they are below it there
AMONG_DISTORTED = 0.2  # probability of each other distortion in half of these
CLICKS = 5  # of so many sounds without a voice one is of keys and knocks: they are voice-like
RULES, REST = "", "-"  # who shows rule-made motion, or none
_WHO = {"rules": RULES, "rest": REST}


@dataclass(frozen=True)
class Ears:
    """The phonetic encoder, and the chain that it is added to."""

    phones: AudioEncoder
    audio: AudioEncoder
    student: Denoiser  # conditioned on gaze, without a contact head

    @torch.no_grad()
    def hear(
        self, sound: np.ndarray, gaze: np.ndarray, rng: np.random.Generator | None
    ) -> tuple[np.ndarray, np.ndarray]:
        """[800 T], [T, 6] -> log-odds [T, D], the student's codes [T, 256].

        rng: of the voice, which is another's; None: as it is.
        """
        heard = torch.from_numpy(sound)[None]
        says = stacked(warped(self.phones, rng), heard)[0]
        noise = torch.randn(1, len(says), self.student.config.expression_dim)
        tau = torch.tensor([self.student.config.num_steps])
        look = torch.from_numpy(gaze)[None]
        x0 = self.student(noise, tau, stacked(self.audio, heard), look)
        return says.numpy(), self.student.unstandardise(x0)[0].numpy()


@dataclass(frozen=True)
class SpokenFrames:
    """Frames of clips, end to end."""

    heard: np.ndarray  # [N, D] float16 audio features of the phonetic encoder
    own: np.ndarray  # [N, 256] float16, what the old chain shows
    rig: np.ndarray  # [N, 55] float16, the truth: the rig, then the tongue's tip and back
    phones: np.ndarray  # [N] int8, -1 unknown
    voice: np.ndarray  # [N] str, the talker's, RULES or REST
    lengths: np.ndarray  # [C] int64 frames of the clips
    plain: np.ndarray  # [N] bool: of few clips, phones known, undistorted but for other voices

    def followed_by(self, more: "SpokenFrames") -> "SpokenFrames":
        return SpokenFrames(
            *(np.concatenate([part, vars(more)[name]]) for name, part in vars(self).items())
        )

    def without(self, names: tuple[str, ...]) -> "SpokenFrames":
        """The same without these talkers; raise InputError where there is no such talker."""
        check_left_out(names, sorted(set(self.voice.tolist()) - {RULES, REST}))
        if not names:
            return self
        kept = ~np.isin(self.voice, names)
        parts = {name: part[kept] for name, part in vars(self).items() if name != "lengths"}
        clips = np.repeat(np.arange(len(self.lengths)), self.lengths)[kept]
        return SpokenFrames(**parts, lengths=np.unique(clips, return_counts=True)[1])


def hear_pack(
    pack: Path, ears: Ears, recipe: str, *, seed: int, versions: int, noises: int, resumed: bool
) -> SpokenFrames:
    """Frames of a pack, from its cache if `recipe`, which identifies the networks, is the same.

    Raises InputError where a run that is resumed finds those of another."""
    recipe = f"{recipe} {seed} {versions} {noises} tongue, plain, syllables, near"
    parts = _parts(pack, seed, versions, noises)
    heard = _heard(pack / "spoken.npz", recipe, parts, ears, resumed)
    assert heard is not None  # noises at least
    return heard


def hear_among(
    pack: Path, ears: Ears, recipe: str, *, seed: int, resumed: bool
) -> SpokenFrames | None:
    """Further versions of tracked clips, if there are any, in all of which other people talk: what
    hears voices learns from them who is near. Kept as those of `hear_pack`."""
    parts = _among_parts(pack, seed)
    return _heard(pack / "among.npz", f"{recipe} {seed} among", parts, ears, resumed)


Part = tuple[Crop, str, np.random.Generator, bool]  # whose it is, whether it is plain


def _heard(
    path: Path, recipe: str, parts: Iterator[Part], ears: Ears, resumed: bool
) -> SpokenFrames | None:
    if (before := kept(path, recipe, SpokenFrames, resumed=resumed)) is not None:
        return before
    rows = []
    for part, voice, rng, plain in tqdm(parts, "clips", mininterval=2):
        torch.manual_seed(int(rng.integers(1 << 62)))
        heard, own = ears.hear(part.audio, part.gaze.reshape(-1, 6), None if plain else rng)
        rows.append([
            heard.astype(np.float16), own.astype(np.float16), _with_tongue(part).astype(np.float16),
            part.phones.astype(np.int8), np.full(len(heard), voice), np.array([len(heard)]),
            np.full(len(heard), plain),
        ])  # fmt: skip
    if not rows:
        return None
    spoken = SpokenFrames(*(np.concatenate(parts) for parts in zip(*rows, strict=True)))
    keep(path, recipe, spoken)
    return spoken


@dataclass(frozen=True)
class _Speakers:
    """The clips of a pack, and who talks beside them."""

    clips: list[Clip]
    rare: set[str]  # talkers who have few tracked clips
    crowd: Crowd
    same: Crowd  # words and pauses like those of the tracked ones
    real: Crowd  # people without text

    @staticmethod
    def of(pack: Path) -> "_Speakers":
        everything = list(iter_pack(pack, "train"))
        clips = [clip for clip in everything if clip.truth in ("tracked", *_WHO)]
        crowd = Crowd([c.audio for c in everything if c.truth in ("rules", "envelope")])
        real = [c.audio for c in everything if c.truth == "envelope"]
        voices = [clip.voice for clip in clips if clip.truth == "tracked"]
        most = max((voices.count(voice) for voice in set(voices)), default=1)
        rare = {voice for voice in voices if voices.count(voice) < most / 4}
        many = [c.audio for c in clips if c.truth == "tracked" and c.voice not in rare]
        same = Crowd(many) if many else crowd
        return _Speakers(clips, rare, crowd, same, Crowd(real) if real else crowd)


def _among_parts(pack: Path, seed: int) -> Iterator[Part]:
    """Half of the versions plain but for the others."""
    speakers = _Speakers.of(pack)
    crowds = speakers.same, speakers.crowd, speakers.real
    tracked = [clip for clip in speakers.clips if clip.truth == "tracked"]
    for index, clip in enumerate(tracked):
        rng = np.random.default_rng([seed, index, AMONG])
        for version in range(AMONG * (RARE if clip.voice in speakers.rare else 1)):
            plain = version % 2 == 0
            p = 0.0 if plain else AMONG_DISTORTED
            part = crop(clip, min(clip.num_frames, LONGEST), rng, p)
            level = part.audio.std() * 10 ** (-rng.uniform(*AMONG_DB) / 20)
            others = level * crowds[rng.integers(len(crowds))].talk(len(part.audio), rng)
            sound = np.clip(part.audio + others, -1, 1).astype(np.float32)
            yield replace(part, audio=sound), clip.voice, rng, plain


def _parts(pack: Path, seed: int, versions: int, noises: int) -> Iterator[Part]:
    """Each clip as often as it is used, sounds without a voice, and clips of those who have few,
    plain; with the talker of each and whether it is plain."""
    speakers = _Speakers.of(pack)
    clips, rare, crowd, same = speakers.clips, speakers.rare, speakers.crowd, speakers.same
    few = [c for c in clips if c.voice in rare and c.truth == "tracked" and (c.phones >= 0).any()]
    for index, clip in enumerate(clips):
        rng = np.random.default_rng([seed, index])
        count = RARE * versions if clip.voice in rare and clip.truth == "tracked" else versions
        if clip.truth == "rules":
            count = int(rng.random() < RULES_KEPT)
        for _ in range(count):
            alike = clip.truth == "tracked" and rng.random() < ALIKE
            others = same if alike else crowd
            yield _cropped(clip, others, rng), _WHO.get(clip.truth, clip.voice), rng, False
    for index in range(noises):
        rng = np.random.default_rng([seed, len(clips) + index])
        kinds = NOT_SPEECH if index % CLICKS else (clicks,)
        sound = not_speech(LONGEST * PACK_SAMPLES_PER_FRAME, rng, kinds)
        gaze = np.tile(np.array(AHEAD, np.float32), (LONGEST, 1))
        rig, tongue = (np.zeros((LONGEST, n), np.float32) for n in (clips[0].rig.shape[1], 3))
        silent = np.zeros(LONGEST, np.int64)
        part = Crop(audio=sound, clean=sound, rig=rig, tongue=tongue, gaze=gaze, phones=silent)
        yield part, REST, rng, False
    for index, clip in enumerate(few):
        rng = np.random.default_rng([seed, len(clips) + noises + index])
        for others in (None, same.talk, same.in_syllables):
            yield _plain(clip, others, rng), clip.voice, rng, True


def _with_tongue(part: Crop) -> np.ndarray:
    """[T, 55]. A tongue that is out is one whose tip is up: the face has nothing further."""
    out, tip, back = part.tongue.T
    tip = np.maximum(tip, np.minimum(2 * out, 1))
    return np.concatenate([part.rig, np.stack([tip, back], 1)], 1)


def _plain(clip: Clip, others: Noise | None, rng: np.random.Generator) -> Crop:
    """A whole clip as it was recorded, or with other voices below it."""
    clean = clip.audio.astype(np.float32) / 32768
    heard = clean
    if others is not None:
        level = clean.std() * 10 ** (-rng.uniform(*PLAIN_DB) / 20)
        heard = clean + level * others(len(clean), rng).astype(np.float32)
    return Crop(
        audio=heard, clean=clean, rig=clip.rig.astype(np.float32),
        tongue=clip.tongue.astype(np.float32), gaze=clip.gaze.astype(np.float32),
        phones=clip.phones.astype(np.int64),
    )  # fmt: skip


def _cropped(clip: Clip, crowd: Crowd, rng: np.random.Generator) -> Crop:
    frames = min(clip.num_frames, LONGEST)
    others = None if clip.truth == "rest" else crowd.talk
    below = TRACKED_DB if clip.truth == "tracked" else OTHERS_DB
    return crop(clip, frames, rng, 0.0 if rng.random() < CLEAN else 0.3, others, below)
