"""Stage "voice-activity": what hears voices learns further sounds that are none.

Runs after `listen`. Where people may talk, the student's own probability of a voice is the target,
so that mouths go on as before; everywhere else it is 0. Only the two layers of the direct path
that hear voices are trained.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional
from tqdm import tqdm

from encoder.audio.encoder import AudioEncoder
from encoder.capture.dataset import PACK_SAMPLES_PER_FRAME, Clip, iter_pack
from encoder.capture.speech.handling import wind
from encoder.capture.speech.voice_like import VOICE_LIKE
from encoder.denoiser.direct import Direct
from encoder.denoiser.model import Denoiser
from encoder.inference import STUDENTS, load_student
from encoder.nn import checkpoint
from encoder.nn.modules import fill
from encoder.training import loop
from encoder.training.checkpoints import load_encoder
from encoder.training.clips import keep, kept, stacked
from encoder.training.presets import Presets
from encoder.training.stages import chain
from encoder.training.stages.contact import fold_scale
from encoder.training.streams.augment import NOT_SPEECH, Crowd, crop, not_speech
from encoder.training.streams.streams import check_left_out
from sensors.types import InputError

FRAMES = 300  # of a crop
PLAIN = 0.5  # share of the clips that are heard as they are
OTHERS_DB = (6, 26)  # that other voices are below a talker
KINDS = (*NOT_SPEECH, *[wind] * 6, *VOICE_LIKE, *VOICE_LIKE)
AT_ONCE = 20_000  # frames


@dataclass(frozen=True)
class HeardFrames:
    """Frames of crops, end to end."""

    heard: np.ndarray  # [N, D] float16 log-odds of the phonetic encoder
    people: np.ndarray  # [N] bool, somebody may talk


@dataclass(frozen=True, kw_only=True)
class VoiceActivityConfig:
    pack: Path
    audio: Path  # the audio encoder, without suffix
    chain: Path  # folder of the student that is trained further
    output: Path
    run: loop.RunSettings
    without: tuple[str, ...] = ()  # talkers who are not heard
    people: int = 1200  # crops of 10 s
    sounds: int = 1800  # the same without a voice
    steps: int = 1500
    batch: int = 1500  # frames of each
    rate: float = 1e-3
    drop: float = 0.1  # dropout: share of what is heard that is left out in a step
    sounds_weight: float = 1.0


preset = Presets(
    VoiceActivityConfig,
    {"debug": {"people": 2, "sounds": 2, "steps": 2, "batch": 8}, "default": {}, "paper": {}},
)


def run(config: VoiceActivityConfig) -> dict[str, float]:
    """Train, and write the student and what extends it; with talkers left out, only the student."""
    sizes, weights, _ = load_student(config.chain, "gaze")
    path = config.chain / STUDENTS["gaze"]
    phones = load_encoder(config.audio).second
    if phones is None or not sizes.direct:
        raise InputError(
            f"train voice-activity: expected a student that hears phones in {config.chain}, got "
            "one that does not; run `livedrive train listen` first"
        )
    direct = fill(Denoiser(sizes), weights, path, "student").direct
    assert isinstance(direct, Direct)
    if not config.without:
        chain.check_whole(config.chain)
    frames = hear(
        config.pack, phones, checkpoint.load(config.audio, "audio")[1]["sha256"],
        without=config.without, crops=(config.people, config.sounds), seed=config.run.seed,
    )  # fmt: skip
    metrics, curve = train(direct, frames, config)
    facts = {"without": config.without, **config.run.card(metrics, curve)}
    chain.write_voice_activity(config.chain, config.output, direct, facts, whole=not config.without)
    return metrics


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
    if (before := kept(path, recipe, HeardFrames)) is not None:
        return before
    rows, people = list[np.ndarray](), list[np.ndarray]()
    parts = _parts(pack, without, crops, seed)
    for sound, talks in tqdm(parts, "sounds", sum(crops), mininterval=2):
        with torch.no_grad():
            rows.append(stacked(phones, torch.from_numpy(sound)[None])[0].numpy())
        people.append(np.full(len(rows[-1]), talks))
    frames = HeardFrames(np.concatenate(rows).astype(np.float16), np.concatenate(people))
    keep(path, recipe, frames)
    return frames


def _parts(
    pack: Path, without: tuple[str, ...], crops: tuple[int, int], seed: int
) -> Iterator[tuple[np.ndarray, bool]]:
    """Sounds [800 T] float32, and whether they are of people: each voice as often as any other."""
    voices: dict[str, list[Clip]] = {}
    for clip in iter_pack(pack, "train"):
        if clip.truth != "rest":
            voices.setdefault(clip.voice, []).append(clip)
    check_left_out(without, sorted(voices))
    voices = {voice: some for voice, some in voices.items() if voice not in without}
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


def train(
    direct: Direct, frames: HeardFrames, config: VoiceActivityConfig
) -> tuple[dict[str, float], loop.Curve]:
    """In place."""
    heard, wanted = frames.heard, np.where(frames.people, voiced(direct, frames.heard), 0)
    some = torch.from_numpy(heard[:: max(len(heard) // AT_ONCE, 1)].astype(np.float32))
    mean, spread = some.mean(0), some.std(0) + 1e-2
    _standardise(direct.hear, mean, spread)
    sides = [np.flatnonzero(frames.people == side) for side in (True, False)]

    def step_losses(step: int, rng: np.random.Generator) -> loop.Losses:
        losses: loop.Losses = {}
        for name, rows in zip(("people", "sounds"), sides, strict=True):
            chosen = rng.choice(rows, config.batch)
            seen = (torch.from_numpy(heard[chosen].astype(np.float32)) - mean) / spread
            odds = direct.voiced(functional.dropout(seen, config.drop))[:, 0]
            target = torch.from_numpy(wanted[chosen].astype(np.float32))
            losses[name] = functional.binary_cross_entropy_with_logits(odds, target)
        return losses | {"total": losses["people"] + config.sounds_weight * losses["sounds"]}

    modules: dict[str, nn.Module] = {"hear": direct.hear, "voice": direct.voice}
    metrics, curve = loop.train(
        "voice activity", modules, step_losses, steps=config.steps, rate=config.rate,
        run=config.run,
    )  # fmt: skip
    with torch.no_grad():
        fold_scale(direct.hear, mean, spread)
    after = voiced(direct, heard)
    people, voices = frames.people, wanted > 0.5
    return {
        **metrics,
        "voices_lost": float((after[voices] < 0.5).sum() / max(voices.sum(), 1)),
        "sounds_as_voices": float((after[~people] > 0.5).sum() / max((~people).sum(), 1)),
    }, curve


@torch.no_grad()
def voiced(direct: Direct, heard: np.ndarray) -> np.ndarray:  # [N, D] -> [N] 0..1
    """Probability of a voice."""
    parts = [
        direct.voiced(torch.from_numpy(heard[i : i + AT_ONCE].astype(np.float32))).sigmoid()
        for i in range(0, len(heard), AT_ONCE)
    ]
    return torch.cat(parts)[:, 0].numpy()


@torch.no_grad()
def _standardise(layer: nn.Linear, mean: Tensor, spread: Tensor) -> None:
    """In place: for inputs less their mean, over their spread; `fold_scale` turns it back."""
    layer.bias.add_(layer.weight @ mean)
    layer.weight.mul_(spread)
